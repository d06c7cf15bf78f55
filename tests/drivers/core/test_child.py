"""A function in a process of its own, also from a script without a guard."""

import gc
import os
import pickle
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import pytest

from drivers.core.child import BOOTSTRAP, KEY_BYTES, Child

SCRIPT = """
from drivers.core.child import Child
import echo
child = Child(echo.twice, (3,), pipes=1)
print(child.pipes[0].recv(), flush=True)
child.end(5.0)
"""
HALF = """
import os, struct, time
def half(pipe):
    try:
        for part in (b"\\0\\0", struct.pack("!h", 30000), *600 * [bytes(40)]):
            os.write(pipe.fileno(), part)
            time.sleep(0.5)
    except BrokenPipeError:
        pass
"""
GARBAGE = """
import gc
def looks(pipe):
    pipe.send((gc.get_threshold(), gc.get_freeze_count()))
"""
ECHO = "def twice(number, pipe):\n    pipe.send(2 * number)\n    pipe.poll(60.0)\n"


def test_a_script_without_a_guard_starts_it_once(tmp_path: Path) -> None:
    (tmp_path / "echo.py").write_text(ECHO)
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.stdout, done.stderr, done.returncode) == ("6\n", "", 0)


def test_it_looks_for_garbage_as_seldom_as_its_starter_and_not_through_imports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "garbage.py").write_text(GARBAGE)
    monkeypatch.syspath_prepend(tmp_path)
    before = gc.get_threshold()
    gc.set_threshold(12_345, 7, 3)
    try:
        child = Child(import_module("garbage").looks, (), pipes=1)
    finally:
        gc.set_threshold(*before)
    thresholds, left_out = child.pipes[0].recv()
    child.end(30.0)
    assert thresholds == (12_345, 7, 3)
    assert left_out > 1000


def test_one_whose_starter_ends_before_it_says_what_to_run_is_silent() -> None:
    done = subprocess.run(
        [sys.executable, "-c", BOOTSTRAP], input="", capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 1)


def test_it_ends_with_its_pipes_or_by_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "echo_later.py").write_text(ECHO)
    monkeypatch.syspath_prepend(tmp_path)
    child = Child(import_module("echo_later").twice, (4,), pipes=1)
    assert child.pipes[0].recv() == 8
    assert child.alive()
    child.end(timeout_s=0.05)  # it sees the pipe end, or is killed
    assert not child.alive()
    with pytest.raises(EOFError):
        child.pipes[0].recv()


def test_one_that_does_not_end_is_gone_when_it_was_ended() -> None:
    child = Child(time.sleep, (60.0,), pipes=0)
    child.end(timeout_s=0.05)
    with pytest.raises(ProcessLookupError):
        os.kill(child.pid, 0)


def test_who_reads_half_a_message_when_it_ends_gets_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In another thread, whose pipe was closed under its read: a `TypeError`."""
    (tmp_path / "echo_half.py").write_text(HALF)
    monkeypatch.syspath_prepend(tmp_path)
    child = Child(import_module("echo_half").half, (), pipes=1)
    with ThreadPoolExecutor(1) as other:
        reading = other.submit(child.pipes[0].recv)
        assert child.pipes[0].poll(30.0)
        time.sleep(0.1)
        child.end(timeout_s=30.0)
        assert isinstance(reading.exception(), EOFError | OSError)


def test_whose_starter_has_ended_meanwhile_it_ends_without_a_word(tmp_path: Path) -> None:
    nobody = str(tmp_path / "socket"), b"k" * KEY_BYTES, 1, "math", "sqrt", ()
    ended = subprocess.run(
        [sys.executable, "-c", BOOTSTRAP],
        input=pickle.dumps((sys.path, gc.get_threshold())) + pickle.dumps(nobody),
        capture_output=True,
        timeout=60,
    )
    assert (ended.returncode, ended.stderr) == (1, b"")
