"""Runs and their logs that are linked, looked at or damaged while a scan writes them or after."""

import os
import shutil
import struct
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from databases import opened
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from paths import ROOT
from programs import python
from small_runs import log, samples, written

from probe.config.rig import Rig
from probe.core.errors import RunFileError
from probe.core.events import Finish, RunEnded
from probe.guards.commands import Control, RunCommand
from probe.scan.remote import ask, listening
from probe.scan.session import scan
from probe.storage.log import unreadable_frames
from probe.storage.rows import Row, link
from probe.storage.run import NotBegun, open_run
from probe.storage.verify import verify
from probe.storage.writer import StoreError, reopen_store

HEADER, FRAME = 32, 24 + 4096  # bytes of the log's header and of each page in it


def killed(folder: Path, blocks: int = 60) -> Path:
    """A run as `kill -9` leaves it: a copy of the file and its log, while both are written."""
    folder.mkdir(exist_ok=True)
    source = folder / "source.run"
    with written(source, blocks):
        for end in ("", "-wal"):
            shutil.copyfile(f"{source}{end}", folder / f"killed.run{end}")
    return folder / "killed.run"


@pytest.fixture(scope="module")
def killed_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return killed(tmp_path_factory.mktemp("killed"))


LOOK = """
import sqlite3, sys
connection = sqlite3.connect(sys.argv[1])
print(connection.execute("SELECT count(*) FROM event").fetchone()[0])
connection.close()  # the last to close a database deletes its log
"""


@pytest.mark.parametrize("look", ["not at all", "read", "try to write"])
def test_looking_at_a_run_in_the_scanning_process_keeps_its_locks(
    look: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.run"
    with written(path, 5) as store:
        if look == "read":
            assert open_run(path).finish is None
            assert verify(path).ok
        elif look == "try to write":
            with pytest.raises(StoreError, match="another scan"):
                reopen_store(path)
        other = python("-c", LOOK, path, status=0)
        assert int(other.stdout) == 7
        assert log(path).exists()
        for n in range(5, 9):
            store(samples(n))
            store.flush()
        for end in ("", "-wal"):
            shutil.copyfile(f"{path}{end}", tmp_path / f"b.run{end}")
    assert verify(tmp_path / "b.run").samples == {"cell": 9 * 25}


def test_a_killed_run_is_whole_through_a_link(tmp_path: Path) -> None:
    path = killed(tmp_path / "runs")
    whole = verify(path)
    assert whole.ok
    assert whole.events == 62
    link = tmp_path / "latest.run"
    link.symlink_to(path)
    assert verify(link).events == whole.events
    assert sum(1 for _ in open_run(link).events()) == whole.events
    with reopen_store(link) as store:
        store(RunEnded(9.0, Finish.ABORTED, ""))
    assert verify(path).events == whole.events + 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["latest.run", "runs"]


def test_a_scan_is_reached_through_a_link(tmp_path: Path) -> None:
    path, link = tmp_path / "a.run", tmp_path / "latest.run"
    path.touch()
    link.symlink_to(path)
    control = Control()
    with listening(control, path):
        ask(link, "abort")
        assert control.command is RunCommand.ABORT


@pytest.mark.parametrize("linked", [True, False])
def test_a_killed_run_without_its_log_is_not_taken_for_whole(linked: bool, tmp_path: Path) -> None:
    path = killed(tmp_path)
    other = tmp_path / "other.run" if linked else path
    if linked:
        os.link(path, other)
    else:
        log(path).unlink()
    report = verify(other)
    assert not report.ok
    assert "RUN-wal is not beside it" in report.problems[0]
    if linked:
        with pytest.raises(StoreError, match="hard link"):
            reopen_store(other)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@example(10)  # the size of its pages
@example(17)  # the salt of the log itself
@example(HEADER + 12)  # the salt of the first page
@example(HEADER + 100)
@example(HEADER + 20 * FRAME + 500)
@given(st.integers(0, HEADER + 35 * FRAME))
def test_a_flipped_bit_of_a_log_is_said_or_harmless(
    tmp_path: Path, killed_once: Path, at: int
) -> None:
    path = tmp_path / "flipped.run"
    shutil.copyfile(killed_once, path)
    content = bytearray(log(killed_once).read_bytes())
    content[at] ^= 1
    log(path).write_bytes(content)
    Path(f"{path}-shm").unlink(missing_ok=True)
    report = verify(path)
    assert report.ok == (report.events == 62), report.problems


@pytest.mark.parametrize("pages", [0, 20])
def test_a_damaged_log_is_kept_when_a_run_goes_on(pages: int, tmp_path: Path) -> None:
    path = killed(tmp_path)
    content = bytearray(log(path).read_bytes())
    content[HEADER + pages * FRAME + 100] ^= 1
    log(path).write_bytes(content)
    report = verify(path)
    assert report.events < 62
    assert "pages of killed.run-wal cannot be read" in report.problems[0]
    with reopen_store(path) as store:
        kept = log(path).with_name("killed.run-wal-damaged")
        assert kept.read_bytes() == content
        store(RunEnded(9.0, Finish.ABORTED, ""))
    gone_on = verify(path)
    assert gone_on.ok, gone_on.problems
    assert gone_on.events == report.events + 1  # what could be read of it is still there


def test_a_log_that_was_used_twice_is_sound(tmp_path: Path) -> None:
    path = killed(tmp_path, blocks=400)  # frames of an earlier generation stay behind the new
    assert verify(path).ok
    assert verify(path).events == 402


def test_a_lost_end_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    written(path, 9).close()
    assert verify(path).ok
    with opened(path, isolation_level=None) as other:
        other.execute("DELETE FROM event WHERE id > 8")
    assert verify(path).problems == (
        "seal: 8 events, but there were 11 when the scan closed the file",
    )


def test_a_last_event_that_was_replaced_and_chained_anew_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    written(path, 9).close()
    columns = "kind, body, times, readings, saturated"
    with opened(path, isolation_level=None) as other:
        row = Row(*other.execute(f"SELECT {columns} FROM event WHERE id = 11").fetchone())
        (before,) = other.execute("SELECT chain FROM event WHERE id = 10").fetchone()
        other_row = row._replace(readings=bytes(8 * 25))
        other.execute(
            "UPDATE event SET readings = ?, sha256 = ?, chain = ? WHERE id = 11",
            (other_row.readings, other_row.sha256, link(before, other_row.sha256)),
        )
    assert verify(path).problems == (
        "seal: the events are not those of when the scan closed the file; some were replaced",
    )


def test_a_run_that_goes_on_and_is_copied_without_its_log_is_not_taken_for_whole(
    tmp_path: Path,
) -> None:
    path, copy = tmp_path / "a.run", tmp_path / "copy.run"
    written(path, 9).close()
    with reopen_store(path) as store:
        store(samples(10))
        store.flush()
        shutil.copyfile(path, copy)
    (problem,) = verify(copy).problems
    assert "the scan did not close this file" in problem


WRITER = """
import sys
from pathlib import Path
from probe.storage.run import open_run
from probe.storage.writer import create_store
events = list(open_run(sys.argv[1]).events())
for n in range(60):
    with create_store(Path(sys.argv[2]) / f"{n}.run") as store:
        for event in events:
            store(event)
"""


def test_a_run_is_read_at_the_instant_it_is_begun_and_closed(tmp_path: Path) -> None:
    source = tmp_path / "source.run"
    written(source, 3).close()
    out = tmp_path / "out"
    out.mkdir()
    with subprocess.Popen([sys.executable, "-c", WRITER, source, out], cwd=ROOT) as writer:
        reads = 0
        while writer.poll() is None:
            for path in sorted(out.glob("*.run"), key=os.path.getmtime)[-1:]:
                with suppress(NotBegun):
                    open_run(path)
                    assert open_run(path).finish is None
                    reads += 1
    assert writer.returncode == 0
    assert reads > 20


@pytest.mark.parametrize("command", ["ANALYZE", "PRAGMA optimize", "PRAGMA wal_checkpoint"])
def test_what_other_programs_do_to_a_database_keeps_it_a_run(command: str, tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    with written(path, 3) as store:
        with opened(path, isolation_level=None) as other:
            other.execute(command)
        store(samples(3))
    assert verify(path).ok
    reopen_store(path).close()


def test_a_trigger_behind_many_tables_is_found(tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    written(path, 3).close()
    copies = (
        "INSERT INTO sqlite_schema SELECT s.type, s.name || x, s.tbl_name, s.rootpage, s.sql FROM "
        "sqlite_schema s, (WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c WHERE "
        "x < 10) SELECT x FROM c)"
    )
    trap = "CREATE TRIGGER zz AFTER INSERT ON event BEGIN DELETE FROM event; END"
    with opened(path, isolation_level=None) as other:
        other.execute("PRAGMA writable_schema = 1")
        other.execute(copies)
        other.execute("INSERT INTO sqlite_schema VALUES ('trigger', 'zz', 'event', 0, ?)", (trap,))
    for reader in (open_run, verify, reopen_store):
        with pytest.raises(RunFileError):
            reader(path)


def test_a_log_that_comes_between_two_looks_is_looked_for_again(
    tmp_path: Path, winkler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    one_station = Rig.model_validate({"scan": {"start_mm": 32, "stations": 1, "hold_s": 0.2}})
    path = scan(one_station, "TIHA", tmp_path, seed=2, respond=winkler).path

    def looks(until: int) -> int:
        """How often it is looked when a log is there after so many looks."""
        looked: list[int] = []

        def state(_: Path) -> tuple[tuple[int, int], bool]:
            looked.append(1)
            return (0, 0), len(looked) > until

        monkeypatch.setattr("probe.storage.reader._state", state)
        assert open_run(path).finish == "completed"
        return len(looked)

    assert looks(1) == looks(0) + 2


@pytest.mark.parametrize("page_size", [0, 511, 768, 131_072])
def test_a_log_whose_pages_no_sqlite_has_is_unreadable(page_size: int, tmp_path: Path) -> None:
    log = tmp_path / "x.run-wal"
    log.write_bytes(struct.pack(">3I", 0x377F0682, 3007000, page_size) + bytes(20 + 24 + 512))
    assert unreadable_frames(log) == 1
