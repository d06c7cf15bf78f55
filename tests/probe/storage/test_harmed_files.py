"""Runs, or their logs, that another program removes or cuts short while a scan writes them."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from databases import opened
from small_runs import log, samples, written

from probe.config.rig import Rig
from probe.core.events import Event, Finish, StationStarted
from probe.scan.session import scan
from probe.storage import moved_away
from probe.storage.moved_away import InPlace
from probe.storage.run import open_run
from probe.storage.verify import verify
from probe.storage.writer import Store, StoreError, reopen_store


def replace(path: Path) -> None:
    path.with_suffix(".other").write_bytes(b"another file")
    path.with_suffix(".other").rename(path)


def to(size: int, which: Callable[[Path], Path] = Path) -> Callable[[Path], None]:
    """Leaves so many bytes of a run, or of its log."""
    return lambda path: os.truncate(which(path), size)


cut, empty, cut_log, empty_log = to(4096), to(0), to(1000, log), to(0, log)


def write_more(store: Store, first: int, last: int) -> None:
    for n in range(first, last):
        store(samples(n))
        store.flush()


GONE: list[Callable[[Path], object]] = [
    Path.unlink, replace, lambda path: path.rename(path.with_suffix(".moved")),
    lambda path: log(path).unlink(), lambda path: shutil.rmtree(path.parent),
]  # fmt: skip
CUT: list[Callable[[Path], object]] = [cut, empty, cut_log, empty_log]
HARMS = [
    *((harm, "deleted, moved or replaced") for harm in GONE),
    *((harm, "cut short") for harm in CUT),
]


@pytest.mark.parametrize("blocks", [20, 300])
@pytest.mark.parametrize(("harm", "said"), HARMS)
def test_a_run_that_is_harmed_while_it_is_written_stops_the_scan_and_is_kept(
    harm: Callable[[Path], object], said: str, blocks: int, tmp_path: Path
) -> None:
    path = tmp_path / "runs" / "a.run"
    with written(path, blocks) as store:
        harm(path)
        with pytest.raises(StoreError, match=rf"{said}.*kept in .*rescued"):
            write_more(store, blocks, blocks + 4)
    assert store.path == path.with_name("a-rescued.run")
    report = verify(store.path)
    assert report.ok, report.problems
    assert report.samples["cell"] == (blocks + 1) * 25
    reopen_store(store.path).close()


def test_what_was_rescued_before_is_kept_too(tmp_path: Path) -> None:
    path, earlier = tmp_path / "a.run", tmp_path / "a-rescued.run"
    earlier.write_bytes(b"of yesterday")
    with written(path, 5) as store:
        path.unlink()
        with pytest.raises(StoreError, match="rescued-2"):
            write_more(store, 5, 9)
    assert store.path == tmp_path / "a-rescued-2.run"
    assert earlier.read_bytes() == b"of yesterday"


def test_what_came_during_the_last_commit_is_kept_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.run"
    with written(path, 5) as store:
        look = store._in_place.lost

        def look_late() -> Path | None:
            store(samples(6))
            path.unlink(missing_ok=True)
            return look()

        monkeypatch.setattr(store._in_place, "lost", look_late)
        store(samples(5))
        with pytest.raises(StoreError, match="rescued"):
            store.flush()
    assert verify(store.path).samples["cell"] == 7 * 25


@pytest.mark.parametrize("looked", [0, 1, 2])
@pytest.mark.parametrize("harm", [cut_log, empty_log])
def test_a_log_that_is_cut_between_a_look_and_what_follows_is_noticed(
    harm: Callable[[Path], None], looked: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the commit, within it and after it: SQLite writes on behind a hole without a word."""
    path = tmp_path / "a.run"
    looks = 0
    look = InPlace.lost

    def lost(self: InPlace) -> str | None:
        nonlocal looks
        found = look(self)
        if looks == looked:
            harm(path)
        looks += 1
        return found

    with written(path, 20) as store:
        monkeypatch.setattr(InPlace, "lost", lost)
        with pytest.raises(StoreError, match="cut short"):
            write_more(store, 20, 24)


def test_a_long_run_that_is_cut_short_is_kept(tmp_path: Path) -> None:
    """Longer than what SQLite keeps in memory unasked, 2 MB."""
    path = tmp_path / "a.run"
    with written(path, 1) as store:
        for n in range(1, 3500):
            store(samples(n))
        store.flush()
        cut(path)
        with pytest.raises(StoreError, match=r"cut short.*kept in .*rescued"):
            write_more(store, 3500, 3504)
    report = verify(store.path)
    assert report.ok, report.problems
    assert report.samples["cell"] == 3501 * 25


@pytest.mark.parametrize("harm", [replace, cut, empty, empty_log])
def test_a_scan_says_where_a_run_is_kept_that_was_harmed(
    harm: Callable[[Path], None], tmp_path: Path, winkler: Any
) -> None:
    def look(event: Event) -> None:
        if isinstance(event, StationStarted) and event.station == 2:
            for path in tmp_path.glob("*.run"):
                harm(path)

    rig = Rig.model_validate({"scan": {"start_mm": 24, "stations": 4}})
    done = scan(rig, "TIHA", tmp_path, observers=[look], respond=winkler)
    assert done.ended.finish is Finish.FAULTED
    assert str(done.path) in done.ended.reason
    if "could not be kept elsewhere" not in done.ended.reason:
        assert harm is not replace or done.path.name.endswith("-rescued.run")
        report = verify(done.path)
        assert report.ok, report.problems
        assert report.stations_complete >= 2


@pytest.mark.parametrize("mode", ["PASSIVE", "FULL", "RESTART", "TRUNCATE"])
def test_another_programs_checkpoint_is_no_harm(mode: str, tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    with written(path, 30) as store:
        with opened(path, isolation_level=None) as other:
            other.execute(f"PRAGMA wal_checkpoint({mode})")
        write_more(store, 30, 40)
    assert store.path == path
    assert verify(path).samples["cell"] == 40 * 25


def test_a_log_that_nobody_could_copy_costs_no_more_than_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise OSError("no room")

    path = tmp_path / "a.run"
    with written(path, 300) as store:
        empty_log(path)
        monkeypatch.setattr(moved_away.os, "open", fails)
        with pytest.raises(StoreError, match=r"cut short.*could not be kept elsewhere.*no room"):
            write_more(store, 300, 304)
    monkeypatch.undo()
    assert store.path == path
    assert sum(1 for _ in open_run(path).events()) > 100


def test_a_run_of_which_too_little_is_in_memory_is_not_said_to_be_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    with written(path, 1) as store:
        store._connection.execute("PRAGMA cache_size = 10")
        write_more(store, 1, 600)
        cut(path)
        with pytest.raises(StoreError, match=r"cut short.*could not be kept elsewhere"):
            write_more(store, 600, 604)
