"""Whole processes, and how many: Ctrl-C, kill -9 and resume, finite elements included."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from databases import opened
from programs import begun, ended
from rig_files import rig_file

from probe.cli import main
from probe.cli.command_line import ONE_THREAD


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    return rig_file(tmp_path, "TIHA", start_mm=28.0, stations=3)


@contextmanager
def scanning(rig: Path, until: str) -> Iterator[subprocess.Popen[str]]:
    """A scan in real time, as far as a line with ``until`` on its standard error."""
    with begun("scan", rig, "--out", rig.parent, "--real-time", "--json") as process:
        try:
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
    resumed = ended("resume", run, "--json", status=0)
    reported = json.loads(resumed.stdout)
    assert reported["finish"] == "completed"
    assert [one["x_mm"] for one in reported["stations"]] == pytest.approx([28, 32, 36])
    with opened(run) as connection:
        assert connection.execute(query).fetchall() == before


def test_watch_ends_by_ctrl_c_as_something_done(rig: Path) -> None:
    with begun("watch", rig) as process:
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


@pytest.mark.parametrize(("own", "then"), [(None, "1"), ("4", "4")])
def test_one_thread_unless_set(own: str | None, then: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ONE_THREAD:
        monkeypatch.setenv(name, own or "")
        if own is None:
            monkeypatch.delenv(name)
    assert main(["--version"]) == 0
    assert [os.environ[name] for name in ONE_THREAD] == [then, then]
