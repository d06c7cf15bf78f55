"""The run file's writer."""

import os
import resource
import sqlite3
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from databases import opened
from hypothesis import given, settings
from hypothesis import strategies as st
from paths import ROOT
from programs import python
from small_runs import CHANNELS, STARTED, samples, written

import probe.storage.disk
import probe.storage.writer
from drivers import Block, Channel
from probe.config.rig import Rig
from probe.core.events import (
    Event,
    Finish,
    Note,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.scan.session import scan
from probe.storage.rows import Row, bytes_per_s, from_row, to_row
from probe.storage.run import RunFileError, open_run
from probe.storage.schema import VERSION, create
from probe.storage.verify import verify
from probe.storage.writer import StoreError, create_store, reopen_store

TWO = Rig.model_validate({"scan": {"start_mm": 30, "stations": 2}})


def one(connection: sqlite3.Connection, query: str) -> Any:
    return connection.execute(query).fetchone()[0]


def same(a: Event, b: Event) -> bool:
    if isinstance(a, Samples) and isinstance(b, Samples):
        arrays = ("time_s", "values", "saturated")
        return (a.device, a.station, a.attempt, a.block.lost) == (
            b.device,
            b.station,
            b.attempt,
            b.block.lost,
        ) and all(getattr(a.block, n).tobytes() == getattr(b.block, n).tobytes() for n in arrays)
    return a == b


def test_every_event_comes_back_as_it_was(tmp_path: Path) -> None:
    reported: list[Event] = [
        STARTED,
        PhaseEntered(0.0, Phase.CONNECTING, None),
        StationStarted(0.1, 0, 1, 1e-3, 0.0),
        samples(2),
        Note(0.2, "warning", "cell", "Kraft über 1 N"),
        StationEnded(0.3, 0, 1, complete=False),
        RunEnded(0.3, Finish.ABORTED, "enough"),
    ]
    with create_store(tmp_path / "a.run") as store:
        for event in reported:
            store(event)
    found = list(open_run(tmp_path / "a.run").events())
    assert len(found) == len(reported)
    assert all(map(same, reported, found))


@given(
    st.integers(0, 40),
    st.integers(0, 4),
    st.randoms(use_true_random=False),
    st.one_of(st.none(), st.integers(0, 10**6)),
)
def test_samples_are_kept_to_the_bit(n: int, channels: int, random: Any, station: Any) -> None:
    draw = np.random.default_rng(random.getrandbits(32))
    bits = draw.integers(0, 2**64, (n, channels), dtype=np.uint64)
    block = Block(
        np.sort(draw.normal(size=n)), bits.view(np.float64), bits % 2 == 0, int(bits.sum() % 100)
    )
    event = Samples("d", block, station, None if station is None else 1)
    assert same(event, from_row(to_row(event)))


@settings(max_examples=200)
@given(st.text(max_size=200), st.sampled_from(["run_started", "samples", "note", "x"]))
def test_no_row_of_nonsense_is_believed(body: str, kind: str) -> None:
    with pytest.raises(RunFileError):
        from_row(Row(kind, body, b"", b"", b""))


def test_rows_that_lie_about_their_shape_are_refused() -> None:
    row = to_row(samples(0))
    for wrong in ("[25,2]", "[24,1]", "[2147483648,1]", "[-1,1]", "[25]", '"25"'):
        with pytest.raises(RunFileError):
            from_row(row._replace(body=row.body.replace("[25,1]", wrong)))
    with pytest.raises(RunFileError, match=r"nest|recursion|JSON"):
        from_row(Row("note", "[" * 100_000, None, None, None))


def test_safe_modes_are_on_and_said_in_the_file(tmp_path: Path) -> None:
    with create_store(tmp_path / "a.run") as store:
        assert one(store._connection, "PRAGMA journal_mode") == "wal"
        assert one(store._connection, "PRAGMA synchronous") == 2
        assert one(store._connection, "PRAGMA user_version") == VERSION
        assert 0 < one(store._connection, "PRAGMA wal_autocheckpoint") <= 1000  # 4 MB
    with opened(tmp_path / "a.run") as other:
        assert one(other, "PRAGMA journal_mode") == "wal"


def test_a_block_is_committed_in_time(tmp_path: Path) -> None:
    with written(tmp_path / "a.run", 0) as store:
        waited_s: list[float] = []
        for n in range(8):
            store.flush()
            began_s = time.monotonic()
            store(samples(n))
            while store.committed < n + 3:
                time.sleep(2e-3)
            waited_s.append(time.monotonic() - began_s)
            held = open_run(tmp_path / "a.run").samples("cell")
            assert len(held.time_s) == 25 * (n + 1)
        assert min(waited_s) < 0.15  # nobody asked for it; the best, since others use the machine


def test_the_end_of_a_run_is_committed_when_it_is_reported(tmp_path: Path) -> None:
    with written(tmp_path / "a.run", 5) as store:
        store(RunEnded(1.0, Finish.ABORTED, "enough"))
        assert open_run(tmp_path / "a.run").finish is Finish.ABORTED


def test_a_run_is_never_overwritten(tmp_path: Path) -> None:
    create_store(tmp_path / "a.run").close()
    with pytest.raises(StoreError, match="never overwritten"):
        create_store(tmp_path / "a.run")


OTHER = """
import sys
from pathlib import Path
from probe.storage.writer import StoreError, reopen_store
try:
    reopen_store(Path(sys.argv[1]))
except StoreError as error:
    print(error)
"""


def test_only_one_writer(tmp_path: Path) -> None:
    with create_store(tmp_path / "a.run"):
        with pytest.raises(StoreError, match="another scan is writing"):
            reopen_store(tmp_path / "a.run")
        done = python("-c", OTHER, tmp_path / "a.run", status=0)
    assert "another scan is writing this run" in done.stdout
    reopen_store(tmp_path / "a.run").close()


def test_a_run_goes_on_only_as_it_began(tmp_path: Path) -> None:
    written(tmp_path / "a.run", 5).close()
    other = {"cell": (Channel("force", "N", "force"),)}  # now real, then simulated
    with reopen_store(tmp_path / "a.run") as store:
        with pytest.raises(StoreError, match=r"already holds samples up to 0\.25 s"):
            store(STARTED)
        with pytest.raises(StoreError, match="channels"):
            store(RunStarted(9.0, "", {}, other))
        store(RunStarted(9.0, "", STARTED.config, CHANNELS))


def test_the_file_refuses_a_station_twice(tmp_path: Path) -> None:
    with written(tmp_path / "a.run", 5) as store:
        store(StationStarted(1.0, 0, 1, 1e-3, 0.0))
        with pytest.raises(StoreError, match="UNIQUE"):
            store.flush()
    assert open_run(tmp_path / "a.run").started == STARTED


def test_a_number_that_is_none_is_not_stored(tmp_path: Path) -> None:
    with written(tmp_path / "a.run", 5) as store:
        store(Note(float("nan"), "info", "x", "y"))
        with pytest.raises(StoreError, match="not JSON compliant"):
            store.flush()
        with pytest.raises(StoreError):
            store(samples(20))


@pytest.mark.parametrize("flushes", [True, False])
def test_a_full_disk_keeps_what_was_committed(flushes: bool, tmp_path: Path) -> None:
    path, until_s = tmp_path / "a.run", time.monotonic() + 20
    with written(path, 5) as store:
        store._connection.execute("PRAGMA max_page_count = 20")
        with pytest.raises(StoreError, match=r"disk is full.*committed before is kept"):
            for n in range(5, 100_000):
                store(samples(n))
                if flushes:
                    store.flush()
                assert time.monotonic() < until_s
    report = verify(path)
    assert report.ok
    assert report.samples["cell"] >= 5 * 25


def test_a_disk_with_no_room_for_the_log_to_grow_does_not_leave_a_run_open(tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with written(path, 5) as store:
        for n in range(5, 20):  # a log longer than the file, which so has room for it
            store(samples(n))
            store.flush()
        size = Path(f"{path}-wal").stat().st_size
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            store.close()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    report = verify(path)
    assert report.ok, report.problems


FULL = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
sys.path.insert(0, sys.argv[3])
from conftest import respond_winkler
from probe.scan.session import scan
from probe.config.rig import Rig
print(scan(scene="TIHA", out=sys.argv[1], respond=respond_winkler).ended.reason)
"""


def test_a_scan_survives_a_file_that_may_not_grow(tmp_path: Path) -> None:
    tests = ROOT / "tests"
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = python("-c", FULL, tmp_path, "500000", tests, cwd=ROOT, env=env, status=0)
    assert "can no longer be stored" in done.stdout
    (path,) = tmp_path.glob("*.run")
    report = verify(path)
    assert report.ok, report.problems
    assert report.events > 10
    assert report.finish is None


def test_a_disk_that_hangs_stops_the_scan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probe.storage.writer, "LATE_S", 0.3)
    store = create_store(tmp_path / "a.run")
    store(STARTED)
    with opened(tmp_path / "a.run", isolation_level=None) as other:
        other.execute("BEGIN IMMEDIATE")  # someone holds the file
        until_s = time.monotonic() + 5
        with pytest.raises(StoreError, match="not taken anything"):
            while time.monotonic() < until_s:
                store(samples(1))
        other.execute("ROLLBACK")
    store.close()


def as_version_1(new: Path) -> Path:
    """The same run as the first version stored it."""
    old = new.with_name("old.run")
    kept = "id, kind, body, times, readings, saturated, sha256"
    with opened(old, isolation_level=None) as connection:
        create(connection, version=1)
        connection.execute("ATTACH ? AS new", (str(new),))
        connection.execute(f"INSERT INTO main.event ({kept}) SELECT {kept} FROM new.event")
    return old


def test_an_older_file_is_read_and_brought_up_to_date(tmp_path: Path, winkler: Any) -> None:
    new = scan(TWO, "TIHA", tmp_path, respond=winkler).path
    old = as_version_1(new)
    before = old.read_bytes()
    assert verify(old).ok
    assert open_run(old).stations().equals(open_run(new).stations())
    assert old.read_bytes() == before  # reading changes nothing
    reopen_store(old).close()
    with opened(old) as one_, opened(new) as two:
        assert one(one_, "PRAGMA user_version") == VERSION
        for query in ("SELECT chain FROM event", "SELECT sql FROM sqlite_schema ORDER BY sql"):
            assert one_.execute(query).fetchall() == two.execute(query).fetchall()


def test_what_is_damaged_stays_so_when_brought_up_to_date(tmp_path: Path) -> None:
    written(tmp_path / "a.run", 5).close()
    old = as_version_1(tmp_path / "a.run")
    with opened(old, isolation_level=None) as other:
        other.execute("UPDATE event SET readings = zeroblob(length(readings)) WHERE id = 4")
    reopen_store(old).close()
    assert "event 4 is damaged: its checksum is wrong" in verify(old).problems


@pytest.mark.parametrize(
    ("empty", "said"), [(False, r"damaged.*palpate verify"), (True, "begin a new scan")]
)
def test_a_damaged_or_empty_file_is_not_added_to(empty: bool, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    if empty:
        path.touch()
    else:
        written(path, 5).close()
        with opened(path, isolation_level=None) as other:
            other.execute("UPDATE event SET body = '{}' WHERE id = 1")
    for _ in range(2):  # the lock is given back
        with pytest.raises(RunFileError, match=said):
            reopen_store(path)


@pytest.mark.parametrize(("channels", "samples"), [(1, 5), (2, 25), (3, 6), (7, 25), (256, 2)])
def test_a_file_is_as_large_as_a_dry_run_says(channels: int, samples: int, tmp_path: Path) -> None:
    cell = tuple(Channel(f"c{n}", "N", "force") for n in range(channels))
    saturated = np.zeros((samples, channels), dtype=bool)
    with create_store(tmp_path / "a.run") as store:
        store(RunStarted(0.0, "2026-01-01T00:00:00+00:00", {}, {"cell": cell}))
        for n in range(600):
            time_s = 1.0 + 0.05 * n + 0.05 / samples * np.arange(samples)
            values = np.random.default_rng(n).standard_normal((samples, channels))
            store(Samples("cell", Block(time_s, values, saturated), 1, 1))
        store(RunEnded(60.0, Finish.COMPLETED, "every station is complete"))
    said = 30.0 * bytes_per_s(20.0 * samples, channels, 20.0)
    assert said / 2 < (tmp_path / "a.run").stat().st_size < said
