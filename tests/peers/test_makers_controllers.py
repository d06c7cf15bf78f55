"""Our drivers against makers' own controllers (docs/reference/devices/README.md gets them)."""

import math
import os
import shutil
import socket
import subprocess
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from waiting import until

from drivers import Pose, Stage, WallClock, open_driver

SIMULATOR = os.environ.get("PALPATE_GRBLHAL", "")
URSIM = os.environ.get("PALPATE_URSIM", "")
IMAGE = "universalrobots/ursim_e-series:5.20.0"
DASHBOARD_PORT = 29999
BOOTS_S, RELEASES_S, ARRIVES_S = 180.0, 60.0, 20.0
IS_AT = "{{range .NetworkSettings.Networks}}{{.IPAddress}}{{end}}"


def there_and_back(stage: Stage, away_m: tuple[float, float, float]) -> None:
    """A move that arrives, and one back that is stopped on its way."""
    start = stage.pose()
    x, y, z = (a + b for a, b in zip(start[:3], away_m, strict=True))
    stage.move(start._replace(x=x, y=y, z=z), 0.02)
    assert stage.moving()
    until(lambda: not stage.moving(), ARRIVES_S)
    assert stage.pose()[:3] == pytest.approx((x, y, z), abs=1e-4)
    stage.move(start, 0.01)
    time.sleep(0.5)
    stage.stop()
    until(lambda: not stage.moving(), ARRIVES_S)
    gone_m = math.dist(stage.pose()[:3], (x, y, z))
    assert 1e-3 < gone_m < math.dist(start[:3], (x, y, z)) - 1e-3
    stage.move(start, 0.02)
    until(lambda: not stage.moving(), ARRIVES_S)
    assert stage.pose()[:3] == pytest.approx(start[:3], abs=1e-4)


@pytest.mark.skipif(not SIMULATOR, reason="PALPATE_GRBLHAL gives no path to a grblHAL_sim")
def test_grblhal_s_own_firmware_moves_and_stops(tmp_path: Path) -> None:
    board, ours = os.openpty()
    tty.setraw(ours)
    with subprocess.Popen([SIMULATOR, "-n"], stdin=board, stdout=board, cwd=tmp_path) as firmware:
        stage = open_driver("stages", "grbl", WallClock(), {"port": os.ttyname(ours)})
        try:
            stage.connect()
            there_and_back(stage, (0.01, 0.005, 0.002))
            stage.stop()
            assert not stage.moving()
        finally:
            stage.close()
            firmware.kill()


@pytest.fixture(scope="module")
def ursim() -> Iterator[str]:
    """The address of a URSim whose robot has its brakes released."""
    if URSIM:
        release_brakes(URSIM)
        yield URSIM
        return
    if shutil.which("docker") is None:
        pytest.skip("no Docker to run URSim by, and PALPATE_URSIM gives no address of one")
    name = docker("run", "--rm", "--detach", IMAGE)
    try:
        host = docker("inspect", "--format", IS_AT, name)
        release_brakes(host)
        yield host
    finally:
        docker("kill", name)


def docker(*words: str) -> str:
    done = subprocess.run(["docker", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"docker {words[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


def dashboard(host: str, order: str) -> str:
    """The answer to one order; nothing while it boots."""
    try:
        with socket.create_connection((host, DASHBOARD_PORT), 2.0) as line:
            line.recv(256)
            line.sendall(order.encode() + b"\n")
            return line.recv(256).decode().strip()
    except OSError:
        return ""


def release_brakes(host: str) -> None:
    until(lambda: dashboard(host, "robotmode") != "", BOOTS_S)
    if "RUNNING" in dashboard(host, "robotmode"):
        return
    dashboard(host, "power on")
    until(lambda: "IDLE" in dashboard(host, "robotmode"), RELEASES_S)
    dashboard(host, "brake release")
    until(lambda: "RUNNING" in dashboard(host, "robotmode"), RELEASES_S)


def test_ursim_is_read_whole_and_in_order(ursim: str) -> None:
    pytest.importorskip("rtde_receive")
    sensor = open_driver("sensors", "ur", WallClock(), {"host": ursim})
    try:
        sensor.connect()
        sensor.start()
        time.sleep(5.0)
        block = sensor.read()
    finally:
        sensor.close()
    assert (block.time_s[1:] > block.time_s[:-1]).all()
    there = len(block.time_s) + block.lost
    assert there == pytest.approx(5.0 * sensor.rate_hz, rel=0.1)  # its container misses cycles
    assert abs(block.values).max() < 100.0


def test_ursim_moves_stops_and_says_what_it_cannot_reach(ursim: str) -> None:
    pytest.importorskip("rtde_control")
    if dashboard(ursim, "is in remote control") != "true":
        pytest.skip(f"remote control is off: switch it on at http://{ursim}:6080/vnc.html")
    keys = {"host": ursim, "silence_s": 1.0, "stop_s": 1.0, "watchdog_s": 1.0, "answer_s": 5.0}
    stage = open_driver("stages", "ur", WallClock(), keys)
    try:
        stage.connect()
        assert stage.enable()
        here = stage.pose()
        assert list(stage.unreachable([here, Pose(5.0, 0.0, 0.0)])) == [Pose(5.0, 0.0, 0.0)]
        there_and_back(stage, (0.0, 0.0, 0.02))
    finally:
        stage.close()
