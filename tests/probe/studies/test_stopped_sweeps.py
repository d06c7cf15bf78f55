"""Sweeps that are stopped: their processes end, and what was solved is kept."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from programs import python

pytestmark = pytest.mark.slow


def test_a_killed_sweep_leaves_no_workers_behind(tmp_path: Path) -> None:
    psutil = pytest.importorskip("psutil", reason="the extra `cluster` is not installed")
    command = [sys.executable, "-m", "probe.cli", "sweep", "TIHA", "--vary",
               "wall_mm=0.4..0.8:200", "--workers", "2", "--out", str(tmp_path / "t.csv"),
               ]  # fmt: skip
    sweeping = psutil.Popen(command, stderr=subprocess.DEVNULL)
    log = tmp_path / "t.rows.jsonl"
    while not log.exists() or len(log.read_text().splitlines()) < 2:
        assert sweeping.poll() is None
        time.sleep(0.2)
    workers = sweeping.children(recursive=True)
    sweeping.kill()
    sweeping.wait()
    assert workers
    _, alive = psutil.wait_procs(workers, timeout=20)
    assert not alive


@pytest.mark.parametrize("begun", [2, 3])
def test_ctrl_c_while_workers_start_is_without_a_traceback(tmp_path: Path, begun: int) -> None:
    psutil = pytest.importorskip("psutil", reason="the extra `cluster` is not installed")
    command = [sys.executable, "-m", "probe.cli", "sweep", "TIHA", "--vary", "wall_mm=0.4..0.8:200",
               "--workers", "2", "--out", str(tmp_path / "t.csv")]  # fmt: skip
    sweeping = psutil.Popen([sys.executable, "-X", "faulthandler", *command[1:]], text=True,
                            stderr=subprocess.PIPE, start_new_session=True)  # fmt: skip
    while len(sweeping.children()) < begun:  # one keeps track of semaphores
        assert sweeping.poll() is None
        time.sleep(0.005)
    time.sleep(0.1 * (begun - 2))
    os.killpg(sweeping.pid, signal.SIGINT)
    try:
        _, err = sweeping.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        os.killpg(sweeping.pid, signal.SIGABRT)  # each says where it stands
        pytest.fail(sweeping.communicate()[1])
    assert sweeping.returncode == 5
    (said,) = err.splitlines()
    assert re.fullmatch(
        rf"stopped: \d+ of 200 points are kept in {tmp_path}/t.rows.jsonl; .*", said
    )


INTERRUPTED = """
import inspect
import sys
from probe.cli import main

left = int(sys.argv.pop(1))

def watch(frame, _event, _argument):
    code = frame.f_code
    futures = code.co_filename.endswith("concurrent/futures/_base.py")
    function = code.co_flags & inspect.CO_OPTIMIZED
    masked = code.co_name in ("__init__", "submit", "add_done_callback")
    return once if futures and function and not masked else None

def once(_frame, event, _argument):
    global left
    left -= event == "line"
    if left == 0:
        raise KeyboardInterrupt
    return once

if __name__ == "__main__":
    sys.settrace(watch)
    sys.exit(main())
"""


@pytest.mark.parametrize("line", [1, 9])
def test_ctrl_c_while_a_pool_of_workers_holds_its_locks_ends_the_sweep(
    tmp_path: Path, line: int
) -> None:
    """At that line of those in which the main thread looks after Python's futures."""
    (tmp_path / "script.py").write_text(INTERRUPTED)
    ended = python(
        "script.py", str(line), "sweep", "TIHA", "--workers", "2", "--vary", "wall_mm=0.4..0.8:4",
        "--model", "small", "--accuracy", "20", "--out", "t.csv", cwd=tmp_path, status=5,
    )  # fmt: skip
    assert "points are kept" in ended.stderr
