"""``palpate emulate``: served until told to stop, failing on command."""

import os
import signal
import socket
import subprocess
from itertools import takewhile
from pathlib import Path

from programs import begun, ended
from waiting import until

from drivers import WallClock
from sim_backend.emulators import ft300
from sim_backend.emulators.solving import AFTER_OTHERS
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import load_scene

FT300 = ("emulate", "ft300", "--scene", "HAOT")


def test_serves_until_terminated_and_fails_on_command(tmp_path: Path) -> None:
    port = tmp_path / "ft300"
    with begun(*FT300, "--at", port, stdin=subprocess.PIPE) as process:
        served = process.stdout.readline()
        assert str(port) in served
        assert "silence" in served
        assert port.is_char_device()
        process.stdin.write("ft300 silence\nft300 nonsense\nft300 ok\n")
        process.stdin.flush()
        said = list(takewhile(lambda line: line != "ft300: ok\n", process.stderr))
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=20)
    assert "ft300: silence\n" in said
    assert any("nonsense" in line and "drop" in line for line in said)
    assert process.returncode == 0
    assert not port.exists()


def test_an_address_that_is_taken_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        done = ended("emulate", "ft300", "--at", f"socket://127.0.0.1:{taken.getsockname()[1]}")
    assert done.returncode == 2
    assert "ft300: its address is taken" in done.stderr


def may_come_first() -> bool:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except OSError:
        return False
    os.sched_setscheduler(0, *before)
    return True


def test_a_controller_comes_first_and_its_solver_last_and_both_end_quietly(tmp_path: Path) -> None:
    process = begun(*FT300, "--at", tmp_path / "ft300", stdin=subprocess.PIPE)
    try:
        process.stdout.readline()
        tasks = Path(f"/proc/{process.pid}/task").glob("*/children")
        (solver,) = [int(pid) for task in tasks for pid in task.read_text().split()]
        if may_come_first():
            assert os.sched_getscheduler(process.pid) == os.SCHED_RR
        assert os.sched_getscheduler(solver) == os.SCHED_OTHER
        until(lambda: os.getpriority(os.PRIO_PROCESS, solver) == AFTER_OTHERS, 60.0)
        for pid in (solver, process.pid):  # Ctrl-C reaches both
            os.kill(pid, signal.SIGINT)
        _, err = process.communicate(timeout=20)
        assert (process.returncode, err) == (0, "")
    finally:
        process.kill()
        process.communicate(timeout=20)


def test_a_device_that_is_no_line_keeps_no_other_from_being_recorded(
    palpate, tmp_path: Path, winkler
) -> None:
    phantom = Phantom(load_scene("TIHA"), WallClock(), winkler)
    rig = tmp_path / "rig.toml"
    text = "[[sensor]]\ndriver = 'netft'\nhost = '127.0.0.1'\n"
    rig.write_text(text)
    command = ("record", rig, "--out", tmp_path, "--seconds", "0.2")
    nothing = palpate(*command)
    assert (nothing.status, nothing.err.count("only lines")) == (2, 1)
    with ft300.emulate(phantom, at="socket://127.0.0.1:0") as served:
        rig.write_text(f"{text}[[sensor]]\ndriver = 'ft300'\nport = '{served.address}'\n")
        outcome = palpate(*command)
    assert (outcome.status, outcome.err.count("only lines")) == (0, 1), outcome.err
    assert "ft300.toml" in outcome.out
