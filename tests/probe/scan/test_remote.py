"""A window's command reaches the scan, and nobody else's does."""

import json
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from paths import ROOT

from probe.guards.commands import Control, RunCommand
from probe.scan.remote import NotRunning, ask, control_path, listening


@pytest.mark.parametrize(
    ("word", "command"),
    [
        ("pause", RunCommand.PAUSE_AFTER_STATION),
        ("abort", RunCommand.ABORT),
        ("stop", RunCommand.STOP),
    ],
)
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


@pytest.mark.parametrize(
    "line", [b"", b"{}", b"[]", b'"stop"', b"\xff\xfe", b'{"token": "guess", "word": "stop"}']
)
def test_strangers_and_noise_change_nothing(line: bytes, tmp_path: Path) -> None:
    control = Control()
    with listening(control, tmp_path / "a.run"):
        path = control_path(tmp_path / "a.run")
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        port = json.loads(path.read_text())["port"]
        with socket.create_connection(("127.0.0.1", port), 1) as peer:
            peer.sendall(line + b"\n")
            assert peer.recv(100) != b"ok\n"
    assert control.command is RunCommand.RESUME


def test_a_word_that_it_does_not_know_leaves_the_scan_listening(tmp_path: Path) -> None:
    """A window of a later version may say it, with the secret."""
    control, run = Control(), tmp_path / "a.run"
    with listening(control, run):
        where = json.loads(control_path(run).read_text())
        with socket.create_connection(("127.0.0.1", where["port"]), 5) as peer:
            said = json.dumps({"token": where["token"], "word": "rewind"})
            peer.sendall(said.encode() + b"\n")
            assert peer.recv(100) == b"unknown word\n"
        ask(run, "stop")
    assert control.command is RunCommand.STOP


def test_a_flood_of_connections_takes_no_threads_and_hides_no_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Anybody on this machine may connect; only who has the secret is heard."""
    monkeypatch.setattr("probe.scan.remote.TIMEOUT_S", 30.0)
    control, before = Control(), threading.active_count()
    with listening(control, tmp_path / "a.run"):
        port = json.loads(control_path(tmp_path / "a.run").read_text())["port"]
        crowd = [socket.create_connection(("127.0.0.1", port), 5) for _ in range(300)]
        assert threading.active_count() <= before + 1
        ask(tmp_path / "a.run", "stop")
        assert control.command is RunCommand.STOP
        assert crowd[0].recv(100) == b""  # who came first gave way
        for peer in crowd:
            peer.close()


def test_a_peer_that_says_nothing_is_hung_up_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("probe.scan.remote.TIMEOUT_S", 0.1)
    with listening(Control(), tmp_path / "a.run"):
        port = json.loads(control_path(tmp_path / "a.run").read_text())["port"]
        with socket.create_connection(("127.0.0.1", port), 10) as peer:
            assert peer.recv(100) == b""
