"""Guards in a process of their own, on emulated devices that a third process tells the truth of.

Whatever happens to the scan's process, the probe is stopped and lifted.
"""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from grbl_ft300 import DEVICES
from waiting import first_of_all

from drivers import DeviceFault, WallClock
from probe.guards import guard_client
from probe.guards.commands import Control
from probe.guards.guard_client import GuardClient
from probe.guards.guard_process import Order
from probe.scan.session import resolve_rig
from probe.storage.run import open_run
from probe.storage.verify import verify
from sim_backend import load_scene
from sim_backend.emulators import ft300, grbl
from sim_backend.phantom.phantom import Phantom, Respond

RIG = (
    DEVICES
    + """
[scan]
start_mm = 32.0
stations = 1
hold_s = {hold_s}
settle_s = 0.15
[safety]
max_force_n = {limit_n}
silence_s = 5.0
late_s = 5.0
hardest_n_mm = 1.0
"""
)
SCAN = """
import ctypes, sys, time
from probe.guards.commands import Control, ctrl_c
from probe.scan.session import scan
from probe.core.events import PhaseEntered, Samples

entered = []

def say(event):
    if isinstance(event, PhaseEntered):
        entered.append(event.phase.value)
        print(event.phase.value, flush=True)
    elif isinstance(event, Samples) and entered[-1] == sys.argv[3]:
        entered.append("")
        if sys.argv[3]:
            ctypes.PyDLL(None).usleep(1_800_000)  # keeps the interpreter all the while

control = Control()
with ctrl_c(control):
    ended = scan(sys.argv[1], out=sys.argv[2], control=control, observers=[say]).ended
print("END", ended.finish.value, ended.reason, flush=True)
"""


class Bench:
    """The world, and a scan of it in another process."""

    def __init__(
        self, world: Phantom, scanning: "subprocess.Popen[str]", out: Path, sensor: Any
    ) -> None:
        self.world, self.scanning, self.out, self.sensor = world, scanning, out, sensor

    def wait_for(self, word: str) -> str:
        """The next line of the scan that begins with ``word``."""
        assert self.scanning.stdout is not None
        line = ""
        for line in self.scanning.stdout:
            if line.startswith(word):
                return line
        pytest.fail(f"the scan ended before it said {word!r}: {line}")

    def wait_until_pressed(self) -> None:
        self.wait_for("holding")
        time.sleep(0.3)
        assert self.height_m() < -2.4e-3

    def guards(self) -> list[int]:
        """The processes that guard: children of the scan, of whichever of its threads."""
        tasks = Path(f"/proc/{self.scanning.pid}/task").glob("*/children")
        return [int(pid) for task in tasks for pid in task.read_text().split()]

    def guard(self) -> int:
        """The process that guards: the scan's only child."""
        (pid,) = self.guards()
        return pid

    def height_m(self) -> float:
        return float(self.world.tip.point(self.world.clock.now())[2])

    def peak_n(self) -> float:
        return float(self.world.force_n(np.arange(0.0, self.world.clock.now(), 1e-3)).max())

    def lifted_within(self, seconds: float) -> float:
        """How long until the true tip rests at the height of travel, 2 mm."""
        began = time.monotonic()
        while time.monotonic() - began < seconds:
            if self.height_m() > 1.9e-3:
                return time.monotonic() - began
            time.sleep(0.01)
        pytest.fail(f"after {seconds} s the tip is at {1e3 * self.height_m():.2f} mm")


@pytest.fixture(autouse=True)
def _emulators_come_before_other_tests() -> Iterator[None]:
    """Real controllers do not share a machine with a test suite; where we may, nor do these."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    yield
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, before)


@pytest.fixture
def world(winkler: Respond) -> Phantom:
    return Phantom(load_scene("TIHA"), WallClock(), winkler, home=(0.032, 0.0, 0.003))


@pytest.fixture
def on(world: Phantom, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Bench]:
    """A scan of a long hold, unless `scan_with` says otherwise."""
    how = {"hold_s": 20.0, "limit_n": 5.0, "block": ""} | getattr(request, "param", {})
    with ExitStack() as devices:
        with first_of_all():
            board, sensor = (
                devices.enter_context(made)
                for made in (
                    grbl.emulate(world, at=str(tmp_path / "board"), homed=True),
                    ft300.emulate(world, at=str(tmp_path / "ft"), noise_n=0.02),
                )
            )
        rig = tmp_path / "rig.toml"
        rig.write_text(RIG.format(board=board.address, sensor=sensor.address, **how))
        scanning = subprocess.Popen(
            [sys.executable, "-c", SCAN, str(rig), str(tmp_path / "runs"), how["block"]],
            stdout=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            yield Bench(world, scanning, tmp_path / "runs", sensor)
        finally:
            scanning.kill()
            scanning.communicate()


def scan_with(**how: Any) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("on", [how], indirect=True, ids=[""])


@pytest.fixture
def client(world: Phantom, tmp_path: Path) -> Iterator[GuardClient]:
    """Guards in another process, of devices that this one emulates; no scan."""
    with (
        grbl.emulate(world, at=str(tmp_path / "board"), homed=True) as board,
        ft300.emulate(world, at=str(tmp_path / "ft")) as sensor,
    ):
        at = {"board": board.address, "sensor": sensor.address}
        (tmp_path / "rig.toml").write_text(RIG.format(**at, hold_s=1.0, limit_n=5.0))
        rig, _ = resolve_rig(tmp_path / "rig.toml", None)
        with GuardClient(Order(rig, WallClock(), None, 0, None), Control()) as made:
            yield made


@scan_with(hold_s=0.2)
def test_a_scan_completes_and_leaves_no_process(on: Bench) -> None:
    on.wait_for("holding")
    guard = on.guard()
    assert "END completed" in on.wait_for("END")
    assert on.scanning.wait(20) == 0
    with pytest.raises(ProcessLookupError):
        os.kill(guard, 0)
    recording = open_run(next(on.out.glob("*.run"))).recording()
    assert len(recording.stations[0].time_s) > 100


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_scan_that_stands_still_or_dies_is_lifted(number: signal.Signals, on: Bench) -> None:
    on.wait_until_pressed()
    os.killpg(on.scanning.pid, number)  # the whole group, as a terminal would
    on.lifted_within(8.0)
    assert on.height_m() > 1.9e-3
    os.killpg(on.scanning.pid, signal.SIGKILL)


def test_ctrl_c_at_the_terminal_lifts(on: Bench) -> None:
    on.wait_for("holding")
    os.killpg(on.scanning.pid, signal.SIGINT)
    assert "END aborted" in on.wait_for("END")
    assert on.height_m() > 1.9e-3


@scan_with(limit_n=0.5, block="indenting")
def test_nothing_in_the_scan_s_process_delays_a_guard(on: Bench) -> None:
    """An observer keeps the interpreter through the whole ramp, in which the limit is exceeded."""
    on.wait_for("indenting")
    on.lifted_within(1.7)  # while the scan's process stands still
    assert "the limit is 0.5 N" in on.wait_for("END")
    # 2.5 mm/s on 480 N/m is 12 mN per sample of 100 Hz; a loaded machine takes some
    assert on.peak_n() < 0.5 + 12 * 0.012


def no_descriptor_left(on: Bench) -> None:
    """Those that a process takes to start are kept."""
    count = len(list(Path(f"/proc/{on.scanning.pid}/fd").iterdir()))
    resource.prlimit(on.scanning.pid, resource.RLIMIT_NOFILE, (count, count))


@pytest.mark.parametrize(
    ("number", "before"),
    [(signal.SIGKILL, None), (signal.SIGSTOP, None), (signal.SIGKILL, no_descriptor_left),
     (signal.SIGKILL, lambda on: on.sensor.fail("silence"))],
    ids=["die", "hang", "no descriptor left", "the sensor is gone too"],
)  # fmt: skip
def test_when_the_guards_die_or_hang_others_take_over_and_lift(
    number: signal.Signals, before: Callable[[Bench], None] | None, on: Bench
) -> None:
    on.wait_until_pressed()
    if before is not None:
        before(on)
    os.kill(on.guard(), number)
    line = on.wait_for("END")
    assert "END faulted guard: the process that guarded has ended; another took" in line
    assert "not lifted" not in line
    assert on.height_m() > 1.9e-3
    run = open_run(next(on.out.glob("*.run")))
    assert run.finish == "faulted"  # and what was read until then is sound
    assert verify(run.path).ok


def test_when_all_who_take_over_die_too_it_is_reported(on: Bench) -> None:
    on.wait_for("holding")
    ended = threading.Event()

    def kill_all() -> None:
        while not ended.wait(0.01):
            for pid in on.guards():
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)

    killer = threading.Thread(target=kill_all)
    killer.start()
    line = on.wait_for("END")
    ended.set()
    killer.join()
    assert "END faulted" in line
    assert "the process that guards has ended: the probe may be in the tissue" in line


def test_who_takes_over_and_hangs_is_not_waited_for(
    client: GuardClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard_client, "BODY", "import time; time.sleep(600)")
    monkeypatch.setattr(guard_client, "OPEN_S", 0.5)
    client._process.kill()
    began_s = time.monotonic()
    with pytest.raises(DeviceFault, match="the probe may be in the tissue"):
        while time.monotonic() < began_s + 20.0:
            client.call("look")
    assert time.monotonic() < began_s + 20.0
    client._process.kill()


def test_guards_that_hang_while_the_scan_waits_for_their_answer_are_replaced(
    client: GuardClient,
) -> None:
    """It waited for 20 s, as for a stage that is slow, with the probe wherever it was."""
    client._process.send_signal(signal.SIGSTOP)
    began_s = time.monotonic()
    with pytest.raises(DeviceFault, match="another took the devices over"):
        client.moving()
    assert time.monotonic() < began_s + 15.0


def test_who_takes_long_to_answer_but_lives_is_waited_for(
    client: GuardClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard_client, "LONG_S", 0.001)  # a tare takes longer
    client.start(homes=False)
    client.tare()
    assert client.look().trip is None


def test_an_answer_that_comes_too_late_is_not_the_next_call_s(
    client: GuardClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = client.pose()
    client._process.send_signal(signal.SIGSTOP)
    with monkeypatch.context() as hurried:
        hurried.setattr(guard_client, "ANSWER_S", 0.05)
        with pytest.raises(DeviceFault, match="no answer to collect"):
            client.call("collect")
    client._process.send_signal(signal.SIGCONT)
    assert client.pose() == here
    assert client.look().trip is None


@pytest.mark.parametrize("homing", [True, False])
def test_who_takes_over_a_stage_that_was_homing_does_not_lift_it(
    homing: bool, client: GuardClient
) -> None:
    if homing:
        client.home()
    client._process.kill()
    while (trip := client.look().trip) is None:
        time.sleep(0.01)
    assert trip.reason == guard_client.DIED
    assert trip.can_retract is not homing
    while not client.call("collect"):  # its sensors are read, and have no tare
        time.sleep(0.01)
    for _ in range(20):
        time.sleep(0.01)
        assert client.collect() == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_guard_that_is_ordered_to_end_lifts_first(number: int, on: Bench) -> None:
    """By itself, as a scan that stands still has no other take over."""
    on.wait_for("holding")
    guard = on.guard()
    os.kill(on.scanning.pid, signal.SIGSTOP)
    os.kill(guard, number)
    on.lifted_within(8.0)
    os.kill(on.scanning.pid, signal.SIGCONT)
    assert "END faulted" in on.wait_for("END")


def test_guards_that_end_as_they_are_closed_are_not_replaced() -> None:
    """Others would open the devices again, and hold them."""
    client = object.__new__(GuardClient)
    client._closing, client._replaced = True, False
    client._replace()
    assert not client._replaced
