"""What `palpate verify` finds; damage to the file itself is in test_run.py."""

import re
import shutil
import sqlite3
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import UnionType
from typing import Any

import numpy as np
import pytest
from paths import ROOT

from probe.config.rig import Rig
from probe.core.errors import RunFileError
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
from probe.report import write_report
from probe.scan.resume import resume, unfinished
from probe.scan.session import scan
from probe.storage.run import NotBegun, open_run
from probe.storage.verify import Report, verify
from probe.storage.writer import create_store

Tamper = Callable[[list[Event]], list[Event]]


@pytest.fixture(scope="module")
def events(path: Path) -> list[Event]:
    return list(open_run(path).events())


def stored(events: list[Event], path: Path) -> Report:
    with create_store(path) as store:
        for event in events:
            store(event)
    return verify(path)


def test_a_sound_run(events: list[Event], tmp_path: Path) -> None:
    report = stored(events, tmp_path / "a.run")
    assert report.ok
    assert (report.stations_complete, report.stations_planned, report.attempts) == (2, 2, 2)
    assert report.finish is Finish.COMPLETED
    assert report.samples["force"] == pytest.approx(2 * 500 * 2.75, rel=0.1)
    assert report.events == len(events)


def test_a_run_cut_off_anywhere_is_sound(events: list[Event], tmp_path: Path) -> None:
    for n, length in enumerate(range(1, len(events), 7)):
        report = stored(events[:length], tmp_path / f"{n}.run")
        assert report.ok, report.problems
        assert report.finish is None


def test_what_a_damaged_index_leaves_whole_is_counted(events: list[Event], tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    stored(events, path)
    with sqlite3.connect(path) as database:
        (page,) = database.execute(
            "SELECT rootpage FROM sqlite_master WHERE name = 'ended_once'"
        ).fetchone()
        (size,) = database.execute("PRAGMA page_size").fetchone()
    database.close()
    with path.open("r+b") as file:
        file.seek((page - 1) * size)
        file.write(bytes(size))
    report = verify(path)
    assert not report.ok
    assert report.events == len(events)


def test_a_note_while_a_press_is_being_closed_is_in_order(
    events: list[Event], tmp_path: Path
) -> None:
    at, ended = next((n, e) for n, e in enumerate(events) if isinstance(e, StationEnded))
    note = Note(ended.time_s + 0.004, "warning", "observer", "window closed")
    assert stored([*events[:at], note, *events[at:]], tmp_path / "a.run").ok
    early = replace(note, time_s=ended.time_s - 3.0)
    assert not stored([*events[: at + 1], early, *events[at + 1 :]], tmp_path / "b.run").ok


def is_one(event: Event, kind: type[Event] | UnionType, keys: dict[str, Any]) -> bool:
    return isinstance(event, kind) and all(getattr(event, k) == v for k, v in keys.items())


def without(kind: type[Event], **keys: Any) -> Tamper:
    return lambda events: [e for e in events if not is_one(e, kind, keys)]


def changed(kind: type[Event] | UnionType, keys: dict[str, Any], **new: Any) -> Tamper:
    return lambda events: [replace(e, **new) if is_one(e, kind, keys) else e for e in events]


def block(edit: Callable[[Any], list[Event]]) -> Tamper:
    """The fourth of the second station."""

    def tamper(events: list[Event]) -> list[Event]:
        at = samples_of(events, 1)[3]
        return [*events[:at], *edit(events[at]), *events[at + 1 :]]

    return tamper


def wide(one: Samples) -> list[Event]:
    values, saturated = (np.repeat(v, 2, axis=1) for v in (one.block.values, one.block.saturated))
    return [replace(one, block=replace(one.block, values=values, saturated=saturated))]


def timeless(one: Samples) -> list[Event]:
    time_s = one.block.time_s.copy()
    time_s[len(time_s) // 2] = np.nan
    return [replace(one, block=replace(one.block, time_s=time_s))]


def tail_lost(events: list[Event]) -> list[Event]:
    lost = set(samples_of(events, 1)[-12:])
    return [e for n, e in enumerate(events) if n not in lost]


def samples_of(events: list[Event], station: int) -> list[int]:
    return [n for n, e in enumerate(events) if isinstance(e, Samples) and e.station == station]


def swapped(events: list[Event]) -> list[Event]:
    first, second = samples_of(events, 0)[4:7:2]
    events[first], events[second] = events[second], events[first]
    return events


@pytest.mark.parametrize("tamper, said", [
    (swapped, "out of order"),
    (block(lambda one: [one, one]), "samples of .* twice"),
    (block(lambda one: [replace(one, station=0)]), "do not belong to station 1"),
    (block(lambda one: [replace(one, station=None, attempt=None)]), "belong to station 2"),
    (tail_lost, "its last samples are not in"),
    (without(PhaseEntered, phase=Phase.HOLDING), "complete without holding"),
    (without(PhaseEntered, phase=Phase.HOLDING), "retracting cannot follow indenting"),
    (changed(StationEnded, {"station": 1}, complete=False),
     "ended as completed without stations [2]"),
    (changed(StationStarted | StationEnded, {"station": 1}, attempt=3),
     "attempt 3 at station 2 should be 1"),
    (changed(StationStarted, {"station": 1}, x_m=32.1e-3), "not where it was planned"),
    (without(StationStarted, station=1), "do not belong to station 2"),
    (changed(RunEnded, {}, time_s=0.1), "at 0.1000 s, after one at"),
    (lambda events: [*events, PhaseEntered(99.0, Phase.FINISHED, None)], "outside of a run"),
    (block(wide), "does not fit the channels"),
    (block(timeless), "out of order"),
    (without(RunStarted), "the run has no beginning"),
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_what_is_wrong_is_said(
    tamper: Tamper, said: str, events: list[Event], tmp_path: Path
) -> None:
    report = stored(tamper(list(events)), tmp_path / "a.run")
    assert not report.ok
    words = said.split(".*")
    assert any(all(word in problem for word in words) for problem in report.problems), (
        report.problems
    )
    assert report.as_json()["ok"] is False


def test_problems_are_counted_not_flooded(events: list[Event], tmp_path: Path) -> None:
    report = stored([*events, *[PhaseEntered(0.0, Phase.HOLDING, None)] * 300], tmp_path / "a.run")
    assert len(report.problems) == 101
    assert report.problems[-1].startswith("and ")


def test_a_run_that_was_killed_before_its_first_event_is_said_alike_by_all(tmp_path: Path) -> None:
    path = tmp_path / "killed.run"
    with create_store(tmp_path / "source.run"):
        for end in ("", "-wal"):
            shutil.copyfile(f"{tmp_path / 'source.run'}{end}", f"{path}{end}")
    said = set()
    for command in (verify, open_run, unfinished, lambda run: write_report(run, tmp_path / "r")):
        with pytest.raises(NotBegun) as error:
            command(path)
        said.add(str(error.value))
    (text,) = said
    assert text.startswith(f"{path}: nothing has been stored in it yet, not one press; ")
    assert "begin a new scan, and the file may be deleted" in text


@pytest.mark.skipif(shutil.which("sqlite3") is None, reason="SQLite's own program is not here")
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_what_is_left_of_a_damaged_run_is_taken_out_as_the_page_says(
    share: float, tmp_path: Path, winkler: Any
) -> None:
    rig = Rig.model_validate({"scan": {"start_mm": 24.0, "stations": 5}})
    path = scan(rig, "TI", tmp_path, respond=winkler).path
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.seek(round(share * size))
        file.write(b"U" * (4096 if share < 0.9 else size))
    with pytest.raises(RunFileError, match=r"damaged .*docs/how-to/runs\.md"):
        open_run(path).recording()
    page = (ROOT / "docs" / "how-to" / "runs.md").read_text(encoding="utf-8")
    take_out, delete = re.findall(r"```bash\n(sqlite3.*?)```", page, re.DOTALL)
    new = tmp_path / "new.run"

    def follow_page(lines: str, first: str = "") -> None:
        shell = [line for line in lines.splitlines() if not line.startswith("palpate")]
        text = "\n".join(shell).replace("NEW", str(new)).replace("RUN", str(path))
        subprocess.run(text.replace("860", first), shell=True, check=True, capture_output=True)

    follow_page(take_out)
    bad = [int(n) for text in verify(new).problems for n in re.findall(r"^event (\d+)", text)]
    if bad:
        follow_page(delete, str(min(bad)))
    left = verify(new)
    assert all(problem.startswith("seal: ") for problem in left.problems), left.problems
    assert len(open_run(new).recording().stations) == left.stations_complete >= int(4 * share)
    with pytest.raises(RunFileError, match="nothing is added to a run whose end is lost"):
        resume(new, respond=winkler)
