"""A window's command reaches the scan, and nobody else's does."""

import os
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from paths import ROOT

from probe.guards.commands import Control, RunCommand
from probe.scan.remote import DOOR, NotRunning, ask, control_path, listening


@pytest.mark.parametrize("word, command", [
    ("pause", RunCommand.PAUSE_AFTER_STATION),
    ("abort", RunCommand.ABORT),
    ("stop", RunCommand.STOP),
])  # fmt: skip
def test_each_word_is_heard(word: str, command: RunCommand, tmp_path: Path) -> None:
    control = Control()
    with listening(control, tmp_path / "a.run"):
        ask(tmp_path / "a.run", word)
        assert control.command is command


def test_resume_takes_back_a_pause(tmp_path: Path) -> None:
    control = Control()
    with listening(control, tmp_path / "a.run"):
        ask(tmp_path / "a.run", "pause")
        ask(tmp_path / "a.run", "resume")
    assert control.command is RunCommand.RESUME


SCAN_WITHOUT_DESCRIPTORS = """
import os, resource, sys, time
from pathlib import Path
from probe.guards.commands import Control, RunCommand
from probe.scan.remote import listening

control = Control()
with listening(control, Path(sys.argv[1])):
    time.sleep(0.1)
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) - 1, hard))
    print("listens", flush=True)
    until_s = time.monotonic() + 20
    while control.command < RunCommand.ABORT and time.monotonic() < until_s:
        time.sleep(0.01)
print(control.command.name)
"""


def test_a_scan_without_descriptors_hears_each_word(tmp_path: Path) -> None:
    run = tmp_path / "a.run"
    command = [sys.executable, "-c", SCAN_WITHOUT_DESCRIPTORS, run]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as scan:
        assert scan.stdout is not None
        assert scan.stdout.readline() == "listens\n"
        for word in ("pause", "resume", "abort"):
            ask(run, word)
        assert scan.stdout.read() == "ABORT\n"


def test_without_a_scan_the_user_is_shown_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(NotRunning, match=r"rig's own stop"):
        ask(tmp_path / "a.run", "stop")
    with listening(Control(), tmp_path / "a.run"):
        left_behind = control_path(tmp_path / "a.run").read_text()
    assert not control_path(tmp_path / "a.run").exists()
    control_path(tmp_path / "a.run").write_text(left_behind)  # as after kill -9
    with pytest.raises(NotRunning, match="does not answer"):
        ask(tmp_path / "a.run", "stop")


def door_of(run: Path) -> str:
    return str(Path(control_path(run).read_text()) / DOOR)


@pytest.mark.parametrize("said", [b"", b"rewind", b"stop now", b"\xff\xfe", b"stop" * 1000])
def test_noise_changes_nothing_and_hides_no_stop(said: bytes, tmp_path: Path) -> None:
    """A window of a later version may say a word that this scan does not know."""
    control, run = Control(), tmp_path / "a.run"
    with listening(control, run):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as peer:
            peer.sendto(said, door_of(run))  # it has no name that could be answered
        time.sleep(0.1)
        assert control.command is RunCommand.RESUME
        ask(run, "stop")
    assert control.command is RunCommand.STOP


def test_a_flood_takes_no_threads_and_hides_no_stop(tmp_path: Path) -> None:
    control, before, run = Control(), threading.active_count(), tmp_path / "a.run"
    with listening(control, run), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as peer:
        peer.setblocking(False)
        for _ in range(3000):
            with suppress(BlockingIOError):
                peer.sendto(b"rewind", door_of(run))
        assert threading.active_count() <= before + 1
        ask(run, "stop")
        assert control.command is RunCommand.STOP


def test_only_its_user_can_reach_a_scan(tmp_path: Path) -> None:
    run, before = tmp_path / "a.run", os.umask(0)
    try:
        with listening(Control(), run):
            folder = Path(door_of(run)).parent
            mode = stat.S_IMODE(folder.stat().st_mode)
    finally:
        os.umask(before)
    assert mode == 0o700
    assert not folder.exists()
    assert not control_path(run).exists()


def test_a_long_name_of_the_folder_for_temporary_files_is_not_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    control, run = Control(), tmp_path / "a.run"
    (long := tmp_path / ("long" * 25)).mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(long))
    with listening(control, run):
        ask(run, "abort")
    assert control.command is RunCommand.ABORT
