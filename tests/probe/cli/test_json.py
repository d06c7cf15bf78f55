"""What other programs rely on: the JSON objects and exit statuses of the commands."""

import json
import math
import os
import shlex
import shutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from databases import opened
from rig_files import rig_file

from drivers import Channel, DeviceFault
from probe.cli import say
from probe.cli.command_line import build
from probe.cli.errors import STATUSES
from probe.cli.finding import show_finding
from probe.cli.logs import log_to
from probe.cli.scan import print_result
from probe.core.errors import RunFileError
from probe.core.events import Finish, Note, RunEnded, RunStarted
from probe.core.log import log_event
from probe.scan.session import ScanResult, scan
from probe.storage.writer import create_store
from sim_backend.models.press import CannotSolve
from sim_backend.phantom.devices import VirtualStage

pytestmark = pytest.mark.usefixtures("springs")

FINDINGS = ("nothing", "tumour", "artery", "stenotic artery", "undecided", "cannot see")
SCAN_KEYS = {"run", "finding", "objects", "stations", "finish", "simulated", "seconds"}
OBJECT_KEYS = {"kind", "position_mm", "position_ci_mm", "peak_pa", "pulse_pa", "confidence"}
STATION_KEYS = {"x_mm", "baseline_pa", "pulse_pa"}


def samples(run: str | Path) -> list[tuple[Any, ...]]:
    """Every block of samples of a run file, as bytes."""
    with opened(run) as connection:
        query = "SELECT device, times, readings, saturated FROM event WHERE kind = 'samples'"
        return connection.execute(f"{query} ORDER BY id").fetchall()


def scan_form(reported: dict[str, Any]) -> None:
    assert reported.keys() >= SCAN_KEYS
    assert reported["finding"] in FINDINGS
    assert reported["finish"] in ("completed", "aborted", "faulted")
    assert reported["seconds"] > 0
    for one in reported["objects"]:
        assert one.keys() >= OBJECT_KEYS
    for one in reported["stations"]:
        assert one.keys() >= STATION_KEYS


@pytest.fixture(scope="module")
def finished(winkler: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished scan, only to be read."""
    return scan(scene="TIHA", seed=1, out=tmp_path_factory.mktemp("runs"), respond=winkler).path


@pytest.fixture
def run_file(finished: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copy(finished, tmp_path))


def test_scan_says_the_same_as_detect(palpate, tmp_path: Path) -> None:
    outcome = palpate("scan", "--scene", "TI", "--out", tmp_path, "--json")
    scanned = outcome.json
    scan_form(scanned)
    assert outcome.out.count("\n") == 1
    assert "station 15 of 15" in outcome.err
    assert "left" in outcome.err
    detected = palpate("detect", scanned["run"], "--json", status=0)
    assert {**scanned, "seconds": 0} == {**detected.json, "seconds": 0}
    assert (scanned["finish"], bool(scanned["simulated"])) == ("completed", True)
    assert [one["x_mm"] for one in scanned["stations"]] == pytest.approx(range(4, 61, 4))


def test_a_person_is_shown_finding_run_and_what_next(palpate, tmp_path: Path) -> None:
    outcome = palpate("scan", "--scene", "TIHA", "--out", tmp_path / "my runs", status=0)
    assert "Finding: " in outcome.out
    assert "SIMULATED" in outcome.out
    (run,) = tmp_path.glob("*/*.run")
    assert str(run) in outcome.out
    assert shlex.join(["palpate", "report", str(run)]) in outcome.out
    assert shlex.quote(str(run)) != str(run)


def test_one_seed_gives_the_same_bytes(palpate, tmp_path: Path) -> None:
    rig = rig_file(tmp_path, "TIHA", start_mm=30, stations=2)

    def scanned(seed: str) -> list[tuple[Any, ...]]:
        outcome = palpate("scan", rig, "--seed", seed, "--out", tmp_path, "--json")
        return samples(outcome.json["run"])

    first = scanned("1")
    assert len(first) > 40
    assert scanned("1") == first
    assert scanned("2") != first


def test_lone_arteries_are_one_station(palpate, tmp_path: Path) -> None:
    runs = []
    for scene in ("HAOT", "SAOT"):
        reported = palpate("scan", "--scene", scene, "--out", tmp_path, "--json").json
        scan_form(reported)
        assert len(reported["stations"]) == 1
        runs.append(reported["run"])
    compared = palpate("compare", *runs, "--json", status=0)
    assert {"diseased", "peak_ratio", "pulse_ratio", "confidence"} <= compared.json.keys()
    assert compared.json["diseased"] in ("A", "B", "neither", "undecided")
    assert "force.force" in compared.json["simulated"]
    printed = palpate("compare", *runs).out
    assert [line for line in printed.splitlines() if line.startswith(("A: ", "B: "))] == [
        f"A: {runs[0]}",
        f"B: {runs[1]}",
    ]
    assert compared.json["reason"] in printed
    assert "SIMULATED" in printed


def test_a_fault_keeps_the_data(palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    move, made = VirtualStage.move, 0

    def jam(self: VirtualStage, *arguments: Any) -> None:
        nonlocal made
        made += 1
        if made == 17:  # setting out to indent at the fourth station
            raise DeviceFault("virtual", "the motor is jammed")
        move(self, *arguments)

    monkeypatch.setattr(VirtualStage, "move", jam)
    outcome = palpate("scan", "--scene", "TIHA", "--out", tmp_path, "--json", status=3)
    assert outcome.json["finish"] == "faulted"
    assert "the motor is jammed" in outcome.err
    run = Path(outcome.json["run"])
    assert str(run) in outcome.err
    scan_form(outcome.json)
    assert len(outcome.json["stations"]) == 3
    monkeypatch.undo()


def test_the_answer_needs_no_further_descriptor(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def none_left(_number: int) -> int:
        raise OSError(24, "Too many open files")

    with say.only_json():
        monkeypatch.setattr(os, "dup", none_left)
        say.answer_json({"status": 2})
        monkeypatch.undo()
    assert json.loads(capfd.readouterr().out) == {"status": 2}


def test_a_fault_is_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log_to(None, verbose=False)
    ended = RunEnded(1.0, Finish.FAULTED, "the disk is full")
    for said_before in (False, True):
        if said_before:  # when it happened
            log_event(Note(1.0, "fault", "store", ended.reason))
        gone = ScanResult(tmp_path / "gone.run", ended, ())
        with pytest.raises(RunFileError, match="no such run file"):
            print_result(gone, 0.0, report=False, as_json=False)
        err = capsys.readouterr().err
        assert err.count(ended.reason) == 1
        assert ("A fault ended the scan: the disk is full" in err) != said_before
        words = "This fault ended the scan. What was read cannot be read now: "
        assert (words in err) == said_before


@pytest.mark.parametrize("ends, says", [
    ([RunEnded(1.0, Finish.FAULTED, "the motor is jammed")],
     "a fault ended it: the motor is jammed"),
    ([RunEnded(1.0, Finish.ABORTED, "stopped by the user")], "it was stopped: stopped by the user"),
    ([], "it was broken off in the first press, or is still in it"),
    ([RunEnded(1.0, Finish.COMPLETED, "every station is complete")], ""),
])  # fmt: skip
def test_detect_says_why_a_run_has_no_station(
    palpate, tmp_path: Path, ends: list[RunEnded], says: str
) -> None:
    channels = {"pad": (Channel("stress", "Pa", "pressure"),)}
    with create_store(tmp_path / "a.run") as sink:
        sink(RunStarted(0.0, "2026-01-01T00:00:00+00:00", {}, channels))
        for event in ends:
            sink(event)
    found = palpate("detect", str(tmp_path / "a.run"), "--json").json
    assert (found["finding"], found["objects"]) == ("undecided", [])
    why = f"; {says}" if says else ""
    assert found["reason"] == f"the run has no complete station{why}"


def test_what_cannot_be_solved(
    palpate, winkler: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def respond(scene: Any, x_m: float, *given: Any) -> Any:
        if x_m > 0.02:
            raise CannotSolve("fold", "the surface folds at 2.1 mm")
        return winkler(scene, x_m, *given)

    monkeypatch.setattr("sim_backend.models.station_response.respond", respond)
    monkeypatch.setattr("sim_backend.models.ahead.processors", lambda: 1)
    outcome = palpate("scan", "--scene", "TIHA", "--out", tmp_path, "--json")
    assert outcome.status == outcome.json["status"] == 4
    assert "the surface folds at 2.1 mm" in outcome.err
    (run,) = tmp_path.glob("*.run")
    assert str(run) in outcome.err
    checked = palpate("verify", run, "--json").json
    assert checked["ok"]
    assert checked["stations_complete"] == 5


def test_press(palpate) -> None:
    command = ("press", "TI", "--x", "32", "--depth", "1", "--accuracy", "5")
    outcome = palpate(*command, "--pressure", "80", "--pressure", "120", "--json", status=0)
    reported = outcome.json
    assert {"scene", "x_mm", "depth_mm", "model", "dofs", "seconds"} <= reported.keys()
    assert reported["error_estimate_pct"] <= 5
    assert [state["pressure_mmhg"] for state in reported["states"]] == [80, 120]
    for state in reported["states"]:
        assert state["force_n_per_mm"] > 0
        assert state["contact_mm"][0] < 32 < state["contact_mm"][1]
        assert 0 < state["contact_error_mm"] < 0.5
        assert {"von_mises_pa", "min_jacobian"} <= state.keys()


def test_a_press_says_its_pulse_its_element_and_why(palpate, tmp_path: Path) -> None:
    """Without pressures it beats as the scene does; the stress is the force over the face."""
    feb = tmp_path / "a.feb"
    command = ("press", "TIHA", "--x", "32", "--depth", "1", "--accuracy", "20")
    reported = palpate(*command, "--json").json
    low, high = reported["states"]
    assert (low["pressure_mmhg"], high["pressure_mmhg"]) == (80, 120)
    face_m2 = 10e-3 * 10e-3
    assert low["contact_stress_pa"] == pytest.approx(low["force_n"] / face_m2)
    assert reported["pulse_pa"] == pytest.approx((high["force_n"] - low["force_n"]) / face_m2)
    assert reported["element"] == "T6"
    said = palpate(*command, "--feb", feb).out
    assert feb.read_text().count("<pt>") == 9  # three curves over 0, diastolic and systolic
    assert "finite strain, T6 elements" in said
    assert f"why: {reported['why']}" in said
    assert f"{reported['pulse_pa']:.1f} Pa of contact stress" in said
    assert "N per mm of finger" in said
    assert "e+" not in said


def test_a_press_at_one_pressure_has_no_pulse_to_say(palpate) -> None:
    said = palpate("press", "TI", "--x", "32", "--depth", "0.1", "--accuracy", "20").out
    assert "why: the cheapest model for this scene" in said
    assert "pulse" not in said


def test_dry_run_moves_nothing(palpate, tmp_path: Path) -> None:
    outcome = palpate("scan", "--scene", "TIHA", "--dry-run", "--out", tmp_path, "--json", status=0)
    assert outcome.json["can_scan"] is True
    assert outcome.json["seconds"] > 30
    assert Path(outcome.json["path_picture"]).stat().st_size > 1000
    assert not list(tmp_path.glob("*.run"))


def test_verify_and_replay(palpate, run_file: Path) -> None:
    checked = palpate("verify", run_file, "--json", status=0)
    assert checked.json["stations_complete"] == 15
    replayed = palpate("replay", run_file, status=0)
    assert "station 15 complete" in replayed.out
    assert "run completed" in replayed.out


def test_verify_refuses_a_damaged_file(palpate, run_file: Path) -> None:
    with opened(run_file) as connection:
        connection.execute("UPDATE event SET readings = zeroblob(length(readings)) WHERE id = 20")
    outcome = palpate("verify", run_file, "--json", status=2)
    assert outcome.json["problems"]


def test_resume_of_a_whole_run_is_refused(palpate, run_file: Path) -> None:
    outcome = palpate("resume", run_file, status=2)
    assert "all 15 stations are complete" in outcome.err


def test_numbers_that_json_does_not_know_become_null() -> None:
    assert say.plain({"a": math.nan, "b": [math.inf, 1.0], "c": (Path("x"),)}) == {
        "a": None,
        "b": [None, 1.0],
        "c": ["x"],
    }


def test_libraries_that_print_do_not_spoil_json(capfd: pytest.CaptureFixture[str]) -> None:
    with say.only_json():
        os.write(1, b"RTDE: connected\n")
        print("from Python")
        say.answer_json({"a": 1})
    out, err = capfd.readouterr()
    assert out == '{"a": 1}\n'
    assert "RTDE: connected" in err
    assert "from Python" in err


def test_every_group_is_there_and_documented() -> None:
    app = build()
    assert app.registered_commands
    for command in app.registered_commands:
        assert command.callback is not None
        assert command.callback.__doc__, f"{command.callback.__name__} has no help"


@pytest.mark.parametrize("place", STATUSES)
def test_every_error_with_a_status_is_known(place: str) -> None:
    """Where it is defined: where it is only imported, it is not known before that is loaded."""
    module, name = place.split(":")
    kind = getattr(import_module(module), name)
    assert issubclass(kind, Exception)
    assert kind.__module__ == module


def test_a_run_without_a_press_shows_no_empty_table(capfd: pytest.CaptureFixture[str]) -> None:
    found = {"stations": [], "objects": [], "simulated": [], "finding": "undecided"}
    show_finding(found | {"reason": "no press can be judged"})
    assert capfd.readouterr().out == "Finding: undecided\n  no press can be judged\n"
