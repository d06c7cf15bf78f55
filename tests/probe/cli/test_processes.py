"""Whole processes: Ctrl-C, kill -9 and resume, the finite elements behind the phantom included."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from databases import opened
from rig_files import rig_file

PALPATE = (sys.executable, "-m", "probe.cli")


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    return rig_file(tmp_path, "TIHA", start_mm=28.0, stations=3)


@contextmanager
def scanning(rig: Path, until: str) -> Iterator[subprocess.Popen[str]]:
    """A scan in real time, as far as a line with ``until`` on its standard error."""
    command = [*PALPATE, "scan", str(rig), "--out", str(rig.parent), "--real-time", "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stderr is not None
            for line in process.stderr:
                if until in line:
                    break
            yield process
        finally:
            process.kill()


def test_ctrl_c_lifts_the_probe_and_ends_the_run(rig: Path) -> None:
    with scanning(rig, until="station 2 of 3") as process:
        time.sleep(1.2)  # until it presses: a probe that is up already has nothing to lift
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    reported = json.loads(out)
    assert process.returncode == 5, err
    assert reported["finish"] == "aborted"
    assert len(reported["stations"]) == 1
    assert f"palpate resume {reported['run']}" in err
    with opened(reported["run"]) as connection:
        query = "SELECT body FROM event WHERE kind = 'phase_entered' ORDER BY id"
        phases = [json.loads(body)["phase"] for (body,) in connection.execute(query)]
    assert phases[-2:] == ["retracting", "finished"]


def test_kill_9_keeps_every_station_and_resume_goes_on(rig: Path) -> None:
    with scanning(rig, until="station 2 of 3") as process:
        time.sleep(0.5)  # twice the longest that a sample may wait to be committed
        process.kill()
    (run,) = rig.parent.glob("*.run")
    with opened(run) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        query = "SELECT times, readings FROM event WHERE station = 0 AND kind = 'samples'"
        before = connection.execute(query).fetchall()
        assert len(before) > 20
    resumed = subprocess.run(
        [*PALPATE, "resume", str(run), "--json"], capture_output=True, text=True, check=False
    )
    assert resumed.returncode == 0, resumed.stderr
    reported = json.loads(resumed.stdout)
    assert reported["finish"] == "completed"
    assert [one["x_mm"] for one in reported["stations"]] == pytest.approx([28, 32, 36])
    with opened(run) as connection:
        assert connection.execute(query).fetchall() == before


def test_watch_ends_by_ctrl_c_as_something_done(rig: Path) -> None:
    command = [*PALPATE, "watch", str(rig)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        head, first = process.stdout.readline(), process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    assert first.startswith("force.force")
    for name, cell in (("noise rms", first.split()[4]), ("age ms", first.split()[-2])):
        end = head.index(name) + len(name)
        assert first[:end].endswith(" " + cell), (head, first)  # each number below its name
    assert "SIMULATED" in first
    assert process.returncode == 0, err
    assert err == ""
