"""A scan that was killed or broke off goes on, and nothing that was complete changes."""

import json
import lzma
import os
import shutil
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_scene import OWN_SCENE
from paths import ROOT

from calibration import Record, fit_force, record, save
from probe.config.rig import Device, Rig
from probe.core.events import Event, Finish, Phase, PhaseEntered, Samples
from probe.guards import prepare
from probe.guards.commands import Control
from probe.scan.resume import resume, unfinished
from probe.scan.session import ScanResult, scan
from probe.storage.csv_import import import_csv
from probe.storage.run import RunFileError, follow, open_run
from probe.storage.verify import verify
from probe.storage.writer import StoreError, create_store, reopen_store

TESTS = ROOT / "tests"
FIVE = {"scan": {"start_mm": 24, "stations": 5}}
KILLED = """
import sys, time
from pathlib import Path
from conftest import respond_winkler
from probe.config.rig import Rig
from probe.scan.session import scan
rig = Rig.model_validate({"scan": {"start_mm": 24, "stations": 5}})
scan(rig, "TIHA", sys.argv[1], seed=7, respond=respond_winkler,
     observers=[lambda _event: time.sleep(1e-3)])
"""


def aborted(out: Path, winkler: Any, station: int, phase: Phase = Phase.HOLDING) -> ScanResult:
    """A scan that is aborted in a phase at a station."""
    control = Control()

    def impatient(event: Event) -> None:
        if isinstance(event, PhaseEntered) and (event.station, event.phase) == (station, phase):
            control.abort()

    rig = Rig.model_validate(FIVE)
    return scan(rig, "TIHA", out, seed=7, control=control, observers=[impatient], respond=winkler)


def blocks(path: Path, stations: set[int]) -> list[tuple[Any, ...]]:
    """The stored bytes of stations' samples."""
    chosen = ", ".join(map(str, stations))
    query = (
        "SELECT body, times, readings, saturated FROM event "
        f"WHERE kind = 'samples' AND station IN ({chosen}) ORDER BY id"
    )
    connection = sqlite3.connect(path)
    found = connection.execute(query).fetchall()
    connection.close()
    return found


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> Path:
    out = tmp_path_factory.mktemp("runs")
    return scan(Rig.model_validate(FIVE), "TIHA", out, seed=7, respond=winkler).path


def check_resumed(path: Path, undisturbed: Path, winkler: Any) -> None:
    """Resume, and compare with the run that nobody disturbed."""
    left = unfinished(path)
    done = set(left.completed)
    before = blocks(path, done)
    assert before == blocks(undisturbed, done)
    assert resume(path, respond=winkler).ended.finish is Finish.COMPLETED
    report = verify(path)
    assert report.ok, report.problems
    assert (report.stations_complete, report.finish) == (5, Finish.COMPLETED)
    assert blocks(path, done) == before
    table = open_run(path).stations()
    for number, rows in table.groupby("station"):
        station = int(str(number)) - 1
        assert rows["attempt"].to_list() == list(range(1, len(rows) + 1))
        assert rows["complete"].to_list() == [False] * (len(rows) - 1) + [True]
        assert len(rows) == left.attempts.get(station, 0) + (station not in done)
    # Signals agree within the noise, also where the press was repeated.
    for ours, theirs in zip(
        open_run(path).recording().stations, open_run(undisturbed).recording().stations, strict=True
    ):
        noise_pa = 0.5e-3 / open_run(path).recording().face_m2
        levels = [
            np.median(s.signal_pa[(s.time_s > s.hold_s) & (s.time_s < s.retract_s)])
            for s in (ours, theirs)
        ]
        assert levels[0] == pytest.approx(levels[1], abs=noise_pa)


@pytest.mark.parametrize(
    ("station", "phase"),
    [(0, Phase.HOLDING), (2, Phase.TRAVELLING), (2, Phase.RETRACTING), (4, Phase.INDENTING)],
)
def test_an_aborted_scan_goes_on(
    station: int, phase: Phase, tmp_path: Path, undisturbed: Path, winkler: Any
) -> None:
    ran = aborted(tmp_path, winkler, station, phase)
    assert ran.ended.finish is Finish.ABORTED
    left = unfinished(ran.path)
    assert left.completed == frozenset(range(station))
    assert left.missing == tuple(range(station, 5))
    assert left.attempts == dict.fromkeys(range(station + 1), 1)
    assert left.start_s > ran.ended.time_s
    check_resumed(ran.path, undisturbed, winkler)


def test_a_scan_can_break_off_more_than_once(
    tmp_path: Path, undisturbed: Path, winkler: Any
) -> None:
    path = aborted(tmp_path, winkler, 1).path
    control = Control()

    def impatient(event: Event) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.INDENTING:
            control.stop()

    resume(path, control=control, observers=[impatient], respond=winkler)
    assert unfinished(path).attempts == {0: 1, 1: 2}
    check_resumed(path, undisturbed, winkler)
    assert open_run(path).stations()["attempt"].max() == 3
    assert verify(path).sessions == 3


def test_noise_is_not_repeated(tmp_path: Path, winkler: Any) -> None:
    path = aborted(tmp_path, winkler, 1, Phase.TRAVELLING).path
    resume(path, respond=winkler)
    held = [
        s.signal_pa[(s.time_s > s.hold_s) & (s.time_s < s.retract_s), 0]
        for s in open_run(path).recording().stations
    ]
    n = min(map(len, held))
    flat = [h[:n] - np.polyval(np.polyfit(range(n), h[:n], 9), range(n)) for h in held]
    assert abs(np.corrcoef(flat[0], flat[1])[0, 1]) < 0.3


def test_a_run_that_ends_amid_a_hold_goes_on_after_its_last_sample(
    tmp_path: Path, winkler: Any
) -> None:
    """Nothing but samples comes for 3 s there, and a power cut leaves them last."""
    rig = Rig.model_validate({"scan": {"start_mm": 24, "stations": 1, "hold_s": 3.0}})
    whole = scan(rig, "TIHA", tmp_path, respond=winkler).path
    events = list(open_run(whole).events())
    lifts = [isinstance(e, PhaseEntered) and e.phase is Phase.RETRACTING for e in events]
    kept = events[: lifts.index(True)]
    path = tmp_path / "cut.run"
    with create_store(path) as store:
        for event in kept:
            store(event)
    last_s = max(float(e.block.time_s[-1]) for e in kept if isinstance(e, Samples))
    assert unfinished(path).start_s > last_s


def test_a_complete_run_is_left_alone(undisturbed: Path, winkler: Any) -> None:
    before = undisturbed.read_bytes()
    with pytest.raises(RunFileError, match="all 5 stations are complete"):
        resume(undisturbed, respond=winkler)
    assert undisturbed.read_bytes() == before


@pytest.mark.parametrize(
    "lost", ["kind = 'run_ended'", "id >= (SELECT min(id) FROM event WHERE station = 3)", "id > 1"]
)
def test_a_run_whose_end_is_lost_is_not_made_sound(
    lost: str, tmp_path: Path, undisturbed: Path, winkler: Any
) -> None:
    """Events that were committed are gone, and a new seal would hide it."""
    path = tmp_path / "cut.run"
    shutil.copyfile(undisturbed, path)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute(f"DELETE FROM event WHERE {lost}")
    before = path.read_bytes()
    (problem,) = (one for one in verify(path).problems if one.startswith("seal"))
    with pytest.raises(RunFileError, match=f"cut.run: {problem}.*begin a new scan"):
        resume(path, respond=winkler)
    assert path.read_bytes() == before
    assert problem in verify(path).problems


def test_an_imported_recording_cannot_be_gone_on_with(tmp_path: Path) -> None:
    """Nothing was moved for it here."""
    rows = "\n".join(f"{n / 100:g},{n}" for n in range(50))
    (tmp_path / "press.csv").write_text(f"time_s,pressure_pa\n{rows}\n")
    path = import_csv(tmp_path / "press.csv", tmp_path / "a.run").path
    with pytest.raises(RunFileError, match=r"a\.run: was imported, not scanned.*palpate detect"):
        unfinished(path)


def test_a_run_is_not_resumed_while_it_is_scanned(tmp_path: Path, winkler: Any) -> None:
    path = aborted(tmp_path, winkler, 1).path
    with reopen_store(path), pytest.raises(StoreError, match="another scan is writing"):
        resume(path, respond=winkler)


def force_calibration(gain: float) -> Record:
    loads = np.linspace(0, 5, 6)[:, None]
    noise = 1e-4 * np.array([[1.0], [-1.0], [1.0], [-1.0], [1.0], [-1.0]])
    return record(fit_force(gain * loads + noise, loads), "force", {})


def test_another_calibration_or_wave_is_another_run(tmp_path: Path, winkler: Any) -> None:
    calibration, wave, scene = (tmp_path / n for n in ("force.json", "wave.csv", "mine.toml"))
    save(force_calibration(1.0), calibration)
    wave.write_text("time_s,pressure_mmhg\n0,80\n0.1,120\n0.4,90\n0.8,80\n")
    scene.write_text(OWN_SCENE + f'[pulse]\nwave = "{wave.name}"\n')
    first = {file: file.read_bytes() for file in (calibration, wave)}
    rig = Rig.model_validate(FIVE | {"calibration": {"force": str(calibration)}})
    control = Control()
    control.abort()
    path = scan(rig, scene, tmp_path, control=control, respond=winkler).path
    assert open_run(path).config["calibration"]["force"]["content"] == json.loads(
        first[calibration]
    )
    save(force_calibration(1.1), calibration)
    with pytest.raises(RunFileError, match="calibration or wave file has changed"):
        resume(path, respond=winkler)
    calibration.write_bytes(first[calibration])
    wave.write_bytes(first[wave].replace(b"120", b"150"))
    with pytest.raises(RunFileError, match="calibration or wave file has changed"):
        resume(path, respond=winkler)
    wave.write_bytes(first[wave])
    assert resume(path, respond=winkler).ended.finish is Finish.COMPLETED


@pytest.mark.parametrize("after", [1, 40, 100])  # events, of some 160
def test_kill_9_loses_nothing_that_was_committed(
    after: int, tmp_path: Path, undisturbed: Path, winkler: Any
) -> None:
    scanning = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path)],
        cwd=TESTS,
        env={"PYTHONPATH": f"{TESTS.parent}"},
    )
    try:
        while not (found := list(tmp_path.glob("*.run"))):
            time.sleep(0.01)
        seen = follow(found[0])
        while next(seen) is None:
            time.sleep(0.01)
        run = open_run(found[0])
        while (committed := len(list(run.events()))) < after:
            time.sleep(0.001)
    finally:
        scanning.kill()
        scanning.wait()
    report = verify(run.path)
    assert report.ok, report.problems
    assert report.events >= committed
    assert report.finish is None
    check_resumed(run.path, undisturbed, winkler)


def test_a_run_from_another_computer_opens_nothing_unasked(
    tmp_path: Path, winkler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rig names a port of this computer, and what reads from it may hang or be somebody's."""
    done = aborted(tmp_path, winkler, 1)
    port = tmp_path / "port"
    os.mkfifo(port)
    left = unfinished(done.path)
    stage = Device.model_validate({"driver": "grbl", "port": str(port)})
    foreign = replace(left, rig=left.rig.model_copy(update={"stage": stage}), computer="another")
    monkeypatch.setattr("probe.scan.resume.unfinished", lambda *_: foreign)
    before = done.path.read_bytes()
    with pytest.raises(RunFileError, match=r"not scanned on this computer.*grbl port = .*--trust"):
        resume(done.path)
    assert done.path.read_bytes() == before


@pytest.mark.parametrize("rehearsed", [True, False])
def test_a_rehearsal_goes_on_as_one_and_nothing_else_does(
    rehearsed: bool, tmp_path: Path, winkler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever real sensor was found, or lost, since."""
    feels_nothing = [rehearsed]
    monkeypatch.setattr(prepare, "needs_rehearsal", lambda *_devices: feels_nothing[0])
    begun = aborted(tmp_path, winkler, 0, Phase.TRAVELLING)
    feels_nothing[0] = not rehearsed
    with pytest.raises(RunFileError, match="rehearsal in the air, and the devices found now"):
        resume(begun.path, respond=winkler)
    assert open_run(begun.path).finish is Finish.ABORTED


def test_complete_stations_are_pressed_again_deeper(tmp_path: Path, winkler: Any) -> None:
    """The first presses stay as they are, the latest complete one of a station counts."""
    path = scan(Rig.model_validate(FIVE), "TIHA", tmp_path, seed=7, respond=winkler).path
    before, first = open_run(path).recording(), blocks(path, {1, 2})
    ended = resume(path, redo=[2, 3], settings={"scan.indentation_mm": "3"}, respond=winkler).ended
    assert ended.finish is Finish.COMPLETED
    after = open_run(path).recording()
    for old, new in zip(before.stations, after.stations, strict=True):
        deep_mm = 3.0 if new.index in (1, 2) else 2.5
        assert 1e3 * new.hold_depth_m == pytest.approx(deep_mm, abs=0.01)
        assert (new.time_s[0] > old.time_s[0]) == (new.index in (1, 2))
    assert blocks(path, {1, 2})[: len(first)] == first
    assert verify(path).ok
    assert unfinished(path).rig.scan.indentation_mm == 2.5, "only those were to be deeper"
    with pytest.raises(RunFileError, match="has no station 6; it has 1, 2, 3, 4, 5"):
        resume(path, redo=[6], respond=winkler)


def test_a_run_of_before_lets_its_stations_be_pressed_again(tmp_path: Path) -> None:
    """Up to version 3 of the file no station could be complete twice."""
    packed = TESTS / "data" / "runs" / "completed.run.xz"
    path = tmp_path / "completed.run"
    path.write_bytes(lzma.decompress(packed.read_bytes()))
    assert resume(path, redo=[1], trust=True).ended.finish is Finish.COMPLETED
    assert verify(path).ok
