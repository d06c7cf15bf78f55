"""What a command says while it takes long, in its log, and of its run at the end."""

import io
import logging
import os
import sys
import time
from pathlib import Path

import pytest
from databases import opened
from programs import python
from rig_files import rig_file
from small_runs import written
from waiting import until

from palpate import press
from probe.cli import main
from probe.cli.progress import counting, solving
from probe.cli.scan import what_is_left
from probe.core.events import Finish, Note, Phase, PhaseEntered, RunEnded
from probe.core.log import log_event


def test_who_waits_sees_what_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is said while capsys empties its buffer would be lost."""
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    with solving(after_s=0.3) as show:
        show("the first mesh")
        show("the second mesh")
        assert not said.getvalue()
        until(lambda: said.getvalue().endswith("\n"), 10.0)
        show("the third mesh")
    assert said.getvalue() == "solving the second mesh\nsolving the third mesh\n"


def test_a_short_wait_is_silent(capsys: pytest.CaptureFixture[str]) -> None:
    with solving(after_s=0.05) as show:
        show("the first mesh")
    time.sleep(0.1)
    assert not capsys.readouterr().err


def test_a_press_says_model_and_mesh() -> None:
    heard: list[str] = []
    press("TI", 32.0, 1.0, accuracy_pct=0.1, solving=heard.append)
    for words in ("finite strain on elements of 0.25 mm", "so far the force is within"):
        assert any(words in one for one in heard), heard


def test_a_long_press_says_so_on_standard_error(palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("probe.cli.progress.PATIENCE_S", 0.0)
    outcome = palpate("press", "TI", "--x", "32", "--depth", "1", "--json")
    assert outcome.json["model"]
    assert "solving" in outcome.err


def test_a_log_has_lines_of_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now_s = 0.0
    monkeypatch.setattr("probe.cli.progress.monotonic", lambda: now_s)
    with counting("points") as progress:
        progress(2, 12)  # done before
        for done in range(3, 13):
            now_s += 4.0
            progress(done, 12)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "3 of 12 points, about 36 s left"
    assert 3 <= len(lines) <= 5
    with counting("points") as progress:
        progress(0, 2)
        now_s += 0.5
        progress(2, 2)
    assert not capsys.readouterr().err


def test_notes_and_faults_are_logged_at_their_level(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, logger="palpate")
    log_event(Note(1.0, "warning", "ft300", "late"))
    log_event(Note(1.0, "fault", "ft300", "silent"))
    log_event(PhaseEntered(1.0, Phase.HOLDING, 0))
    log_event(RunEnded(2.0, Finish.ABORTED, "aborted by the user"))
    assert [(r.levelname, r.getMessage()) for r in caplog.records] == [
        ("WARNING", "ft300: late"),
        ("ERROR", "ft300: silent"),
        ("DEBUG", "holding"),
        ("DEBUG", "run aborted: aborted by the user"),
    ]


def test_importing_says_nothing() -> None:
    code = "import probe.core.log as l; l.LOGGER.error('x')"
    done = python("-c", code, status=0)
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.parametrize("verbose", [False, True])
def test_a_scan_writes_its_log(
    verbose: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, log = rig_file(tmp_path, start_mm=32.0, stations=1), tmp_path / "scan.log"
    options = ["--verbose"] if verbose else []
    assert main(["--log", str(log), *options, "scan", str(rig), "--out", str(tmp_path)]) == 0
    text = log.read_text(encoding="utf-8")
    assert "DEBUG station 1, attempt 1, at x = 32.00 mm" in text
    assert "DEBUG run completed" in text
    reported = capsys.readouterr()
    assert ("debug: holding" in reported.err) == verbose
    assert "holding" not in reported.out


def test_what_was_read_is_where_it_was_looked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    written(path, 60).close()
    assert what_is_left(path) == f"What was read is in {path}"
    with opened(path) as other:
        other.execute("DELETE FROM event WHERE id > 40")
    assert f"40 events are left in {path}, which is damaged" in what_is_left(path)
    os.truncate(path, 0)
    assert what_is_left(path).startswith("What was read cannot be read now: ")
