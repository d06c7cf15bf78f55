"""What happens in a scan goes to Python's logging too: terminal, ``--verbose`` and ``--log``."""

import logging
import subprocess
import sys
from pathlib import Path

import pytest
from rig_files import rig_file

from probe.cli import main
from probe.core.events import Finish, Note, Phase, PhaseEntered, RunEnded
from probe.core.log import log_event


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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")


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
