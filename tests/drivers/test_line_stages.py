"""Zaber, PI and TMCL against emulated controllers: what each says is understood in its words."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import drivers.pi
import drivers.tmcl
import drivers.zaber
from drivers import DeviceFault, MotionFault, Pose, SimulatedClock, WallClock
from drivers.core.abilities import enable
from drivers.core.errors import ConfigError
from drivers.core.leading import Lead
from drivers.core.line import NoAnswer
from drivers.core.line_stage import LineStage
from drivers.core.registry import open_driver
from drivers.core.segments import AHEAD_S, SegmentedMove
from drivers.testing.awake import AwakeTime
from sim_backend import load_scene
from sim_backend.emulators import pi, tmcl, zaber
from sim_backend.emulators.carriage import Carriage
from sim_backend.emulators.serving import Served
from sim_backend.phantom.phantom import Phantom, Respond

EMULATORS: dict[str, Any] = {"zaber": zaber, "pi": pi, "tmcl": tmcl}
HOME = (0.032, 0.0, 0.002)
PATIENT = {"silent_s": 2.0, "answer_s": 1.0}  # the emulator shares this machine with other tests


class Rig:
    def __init__(self, name: str, stage: LineStage, served: Served, phantom: Phantom) -> None:
        self.name, self.stage, self.served, self.phantom = name, stage, served, phantom

    def arrive(self) -> None:
        self.wait_for(lambda: not self.stage.moving())

    def wait_for(self, ready: Callable[[], bool]) -> None:
        with AwakeTime() as awake:
            end_s = awake.now() + 5.0
            while not ready():
                assert awake.now() < end_s
                time.sleep(1e-3)  # who waits here must not keep the others from running

    def until_fault(self, match: str, kind: type[DeviceFault] = DeviceFault) -> None:
        with pytest.raises(kind, match=match):
            self.wait_for(lambda: not self.stage.moving())


@contextmanager
def rig_of(name: str, winkler: Respond, *, homed: bool = True, **keys: Any) -> Iterator[Rig]:
    clock = WallClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=HOME)
    emulator = EMULATORS[name]
    with emulator.emulate(phantom, homed=homed) as served:
        usual = {**emulator.RIG_AXES, "origin_mm": emulator.RIG_ORIGIN_MM, **PATIENT}
        stage = open_driver("stages", name, clock, {**usual, "port": served.address, **keys})
        try:
            stage.connect()
            yield Rig(name, stage, served, phantom)
        finally:
            stage.close()


each = pytest.mark.parametrize("name", EMULATORS)


@each
def test_it_moves_all_axes_in_the_scan_frame_and_they_arrive_together(
    name: str, winkler: Respond
) -> None:
    with rig_of(name, winkler) as rig:
        enable(rig.stage)
        assert rig.stage.pose()[:3] == pytest.approx(HOME, abs=1e-6)
        target = Pose(0.036, -0.002, 0.006)
        rig.stage.move(target, 8e-3)
        rig.arrive()
        assert rig.stage.pose()[:3] == pytest.approx(target[:3], abs=2e-6)
        assert rig.phantom.tip.point(rig.phantom.clock.now()) == pytest.approx(target[:3], abs=2e-6)
        straight = rig.phantom.tip.all_legs()[-1]
        assert straight.speed == pytest.approx(8e-3, rel=0.01)  # 6 mm at 8 mm/s


@each
def test_it_homes_z_first_and_parks(name: str, winkler: Respond) -> None:
    with rig_of(
        name, winkler, homed=False, home=True, max_speed_mm_s=100.0, park_mm=(-10.0, -15.0, 30.0)
    ) as rig:
        enable(rig.stage)  # as a scan does, before it homes
        rig.stage.home()
        legs = rig.phantom.tip.all_legs()[1:]
        first = next(leg for leg in legs if leg.speed > 0)
        assert first.direction == pytest.approx((0.0, 0.0, 1.0))
        assert rig.stage.pose()[:3] == pytest.approx((-0.01, -0.015, 0.03), abs=2e-6)
        enable(rig.stage)


@pytest.mark.parametrize("name", ["zaber", "pi"])
def test_it_does_not_move_where_it_does_not_know_its_place(name: str, winkler: Respond) -> None:
    with (
        rig_of(name, winkler, homed=False) as rig,
        pytest.raises(DeviceFault, match=r"reference.*home it \(home = true"),
    ):
        enable(rig.stage)


@pytest.mark.parametrize("name", ["zaber", "pi"])
def test_what_does_not_know_its_place_when_homed_goes_no_further(
    name: str, winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    axes = {"zaber": drivers.zaber.ZaberAxes, "pi": drivers.pi.PiAxes}[name]
    monkeypatch.setattr(axes, "home", lambda _self, _axis: None)
    with rig_of(name, winkler, homed=False, home=True) as rig:
        enable(rig.stage)
        with pytest.raises(DeviceFault, match="reference"):
            rig.stage.home()


@each
def test_a_stop_on_the_way_home_ends_it(name: str, winkler: Respond) -> None:
    with rig_of(name, winkler, homed=False, home=True) as rig:

        def stop() -> None:
            while not rig.phantom.tip.moving(rig.phantom.clock.now()):
                pass
            rig.stage.stop()

        stopper = threading.Thread(target=stop)
        stopper.start()
        with pytest.raises(DeviceFault, match="stopped on the way"):
            rig.stage.home()
        stopper.join()
        assert rig.phantom.tip.point(rig.phantom.clock.now())[2] < 0.038


FAULTS = [
    ("zaber", "stall", "stalled and stopped", MotionFault),
    ("zaber", "driver off", "driver is disabled", MotionFault),
    ("zaber", "restart", "lost its reference", DeviceFault),
    ("pi", "motion error", "servo was switched off", MotionFault),
    ("tmcl", "limit switch", "left limit switch", MotionFault),
    ("tmcl", "restart", "has restarted", DeviceFault),
]


@pytest.mark.parametrize(("name", "fault", "words", "kind"), FAULTS, ids=lambda v: str(v))
def test_a_fault_is_reported_in_its_words(
    name: str, fault: str, words: str, kind: type[DeviceFault], winkler: Respond
) -> None:
    with rig_of(name, winkler) as rig:
        enable(rig.stage)
        rig.stage.move(Pose(*HOME)._replace(z=-0.002), 1e-3)
        rig.wait_for(lambda: rig.stage.pose().z < 0.0019)
        rig.served.fail(fault)
        rig.until_fault(words, kind)


@pytest.mark.parametrize(
    ("name", "fault"), [("zaber", "stall"), ("tmcl", "limit switch")], ids=["zaber", "tmcl"]
)
def test_after_a_fault_of_motion_it_lifts(name: str, fault: str, winkler: Respond) -> None:
    with rig_of(name, winkler) as rig:
        enable(rig.stage)
        rig.stage.move(Pose(*HOME)._replace(z=-0.002), 1e-3)
        rig.wait_for(lambda: rig.stage.pose().z < 0.0019)
        rig.served.fail(fault)
        rig.until_fault("stalled|limit switch", MotionFault)
        rig.stage.move(Pose(*HOME), 5e-3)
        rig.arrive()
        assert rig.stage.pose().z == pytest.approx(HOME[2], abs=2e-6)


@each
def test_what_a_controller_refuses_is_said(name: str, winkler: Respond) -> None:
    with rig_of(name, winkler) as rig:
        enable(rig.stage)
        if name != "tmcl":  # a module does not know its travel
            with pytest.raises(DeviceFault, match=r"out of (range|limits)"):
                rig.stage.move(Pose(*HOME)._replace(x=0.2), 5e-3)
        with pytest.raises(DeviceFault, match="max_speed_mm_s = 10"):
            rig.stage.move(Pose(*HOME), 0.02)
        with pytest.raises(DeviceFault, match="no axes to tilt"):
            rig.stage.move(Pose(*HOME, 0.1), 5e-3)


@each
def test_an_axis_that_is_not_there_does_not_move(name: str, winkler: Respond) -> None:
    with rig_of(name, winkler, y=None, limits_mm=((-5, 70), (-5, 5), (-4, 30))) as rig:
        assert rig.stage.pose().y == 0.0
        with pytest.raises(DeviceFault, match="no y axis"):
            rig.stage.move(Pose(*HOME)._replace(y=0.001), 5e-3)
        with pytest.raises(DeviceFault, match=r"z = 40 mm; allowed: -4 to 30"):
            rig.stage.move(Pose(*HOME)._replace(z=0.04), 5e-3)


@each
def test_no_axis_at_all_is_a_wrong_rig_file(name: str) -> None:
    with pytest.raises(ConfigError, match="name at least one axis"):
        open_driver("stages", name, WallClock(), {"port": "pty"})


def flipped(answer: bytes) -> Iterator[bytes]:
    for at in range(len(answer)):
        for bit in range(8):
            yield answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]


@pytest.mark.parametrize("name", ["zaber", "tmcl"])
def test_no_answer_with_a_flipped_bit_is_taken(
    name: str, winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each bit of each byte of a position: the sum that goes with it does not match."""
    emulator = EMULATORS[name]
    keys: dict[str, Any] = {"port": "pty", "x": emulator.RIG_AXES["x"]}
    asked: list[bytes] = []

    class Line:
        """A device that answers once, with the next damage."""

        def ask(self, data: bytes, **_how: Any) -> bytes:
            asked.append(data)
            return damage(device.received(data))

        def listen(self, **_how: Any) -> bytes:
            raise NoAnswer(name, "silent")

    monkeypatch.setattr(f"drivers.{name}.Line", lambda *_: Line())
    phantom = Phantom(load_scene("TIHA"), WallClock(), winkler, home=HOME)
    carriage = Carriage(phantom, homed=True)
    if name == "zaber":
        device: Any = zaber.ZaberChain(carriage, check_sums=True)
        axes: Any = drivers.zaber.ZaberAxes(drivers.zaber.ZaberSettings(**keys))
    else:
        device = tmcl.TmclModule(carriage)
        axes = drivers.tmcl.TmclAxes(drivers.tmcl.TmclSettings(**keys))

    def damage(answer: bytes) -> bytes:
        return answer.removesuffix(b"\r\n")

    good = axes.read().places_mm["x"]
    assert good == pytest.approx(52.0, abs=1e-3)
    for n in range(8 * len(damage(device.received(asked[-1])))):

        def damage(answer: bytes, n: int = n) -> bytes:
            return next(islice(flipped(answer.removesuffix(b"\r\n")), n, None))

        with pytest.raises(NoAnswer):
            axes.read()


def test_a_reply_that_comes_too_late_is_not_taken_for_the_next(
    winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    phantom = Phantom(load_scene("TIHA"), WallClock(), winkler, home=HOME)
    device = zaber.ZaberChain(Carriage(phantom, homed=True), check_sums=True)
    late: list[bytes] = []

    class Line:
        """The reply to each question comes again, before that to the next."""

        def ask(self, data: bytes, **_how: Any) -> bytes:
            late.append(device.received(data).removesuffix(b"\r\n"))
            return late.pop(0) if len(late) > 1 else late[0]

        def listen(self, **_how: Any) -> bytes:
            return late[0]

    monkeypatch.setattr("drivers.zaber.Line", lambda *_: Line())
    both = {axis: zaber.RIG_AXES[axis] for axis in "xz"}
    axes = drivers.zaber.ZaberAxes(drivers.zaber.ZaberSettings(port="pty", **both))
    places_mm = axes.read().places_mm
    assert places_mm == pytest.approx({"x": 52.0, "z": places_mm["z"]}, abs=1e-3)
    assert axes.read().places_mm == places_mm


def test_a_motor_that_was_ordered_to_go_and_has_not_set_off_has_not_arrived(
    winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimulatedClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=HOME)
    device = tmcl.TmclModule(Carriage(phantom, homed=True))

    class Line:
        """The module accepts a move a little before its motor turns."""

        def ask(self, data: bytes, **_how: Any) -> bytes:
            answer = device.received(data)
            if tuple(data[1:3]) == (drivers.tmcl.GAP, drivers.tmcl.SPEED):
                answer = answer[:4] + bytes(4)
                answer += bytes([sum(answer) % 256])
            return answer

    monkeypatch.setattr("drivers.tmcl.Line", lambda *_: Line())
    monkeypatch.setattr("drivers.tmcl.time", SimpleNamespace(monotonic=clock.now))
    axes = drivers.tmcl.TmclAxes(drivers.tmcl.TmclSettings(port="pty", x=tmcl.RIG_AXES["x"]))
    axes.move({"x": 54.0}, {"x": 5.0})
    assert axes.read().moving
    clock.sleep_until(10.0)
    assert not axes.read().moving


@pytest.mark.parametrize("name", EMULATORS)
def test_what_is_reported_at_rest_was_read_at_rest(
    name: str, winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An axis that comes to rest between two exchanges of one reading."""
    clock = SimulatedClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=HOME)
    device = {"zaber": lambda c: zaber.ZaberChain(c, check_sums=True),
              "pi": lambda c: pi.PiController(c, servo=True),
              "tmcl": tmcl.TmclModule}[name](Carriage(phantom, homed=True))  # fmt: skip

    class Line:
        """Each exchange takes 20 ms of the world's time, as at 9600 baud."""

        def ask(self, data: bytes, *, end: bytes = b"", **_how: Any) -> bytes:
            clock.sleep_until(clock.now() + 0.02)
            answer = b"".join(device.received(bytes([byte])) for byte in data)
            return answer.removesuffix(end) if end else answer

        def say(self, data: bytes) -> None:
            device.received(data)

    monkeypatch.setattr(f"drivers.{name}.Line", lambda *_: Line())
    module = import_module(f"drivers.{name}")
    keys = {"port": "pty", "x": EMULATORS[name].RIG_AXES["x"]}
    axes = getattr(module, f"{name.title()}Axes")(
        getattr(module, f"{name.title()}Settings")(**keys)
    )
    for n in range(40):  # ends at ever other exchanges
        target_mm = 52.0 + (n % 2) * (1.0 + 0.09 * n)
        axes.move({"x": target_mm}, {"x": 40.0})
        while (reading := axes.read()).moving:
            pass
        assert reading.places_mm["x"] == pytest.approx(target_mm, abs=1e-3)


TOP, BOTTOM = Pose(0.032, 0.0, 0.002), Pose(0.032, 0.0, -0.0024)
PRESS_M_S = 1.2e-3
BUSY_M = 0.1e-3  # 80 ms in which a busy machine looks late at what has happened


def tip_m(rig: Rig) -> float:
    return rig.phantom.tip.point(rig.phantom.clock.now())[2]


def still_m(rig: Rig) -> float:
    """Where the tip comes to rest, as the emulator's side has it."""
    rig.wait_for(lambda: not rig.phantom.tip.moving(rig.phantom.clock.now()))
    rests_m = tip_m(rig)
    time.sleep(0.2)
    assert tip_m(rig) == rests_m
    return rests_m


def press(rig: Rig) -> float:
    """Half a millimetre deep."""
    enable(rig.stage)
    rig.stage.move(BOTTOM, PRESS_M_S)
    rig.wait_for(lambda: tip_m(rig) < -0.5e-3)
    return tip_m(rig)


@each
def test_a_controller_that_is_left_alone_comes_to_rest(name: str, winkler: Respond) -> None:
    """The plug is pulled, or everything that could send dies."""
    with rig_of(name, winkler) as rig:
        before_m = press(rig)
        bound_m = PRESS_M_S * (AHEAD_S + rig.stage._between_s + 0.01)
        rig.served.fail("drop")
        assert before_m - still_m(rig) < bound_m + BUSY_M


@each
def test_a_lift_is_finished_with_nobody_there(name: str, winkler: Respond) -> None:
    with rig_of(name, winkler) as rig:
        press(rig)
        rig.stage.stop()
        rig.wait_for(lambda: not rig.stage.moving())
        rig.stage.move(TOP, PRESS_M_S)
        rig.wait_for(lambda: tip_m(rig) > 0.0)
        rig.served.fail("drop")
        assert still_m(rig) == pytest.approx(TOP.z, abs=5e-6)


@each
def test_a_press_is_not_gone_on_with_when_nobody_checks_the_force(
    name: str, winkler: Respond
) -> None:
    with rig_of(name, winkler) as rig:
        enable(rig.stage)
        rig.stage.move(BOTTOM, PRESS_M_S)
        while tip_m(rig) > -0.5e-3:
            rig.stage.keep_alive()
            time.sleep(1e-3)
        before_m = tip_m(rig)
        assert before_m - still_m(rig) < PRESS_M_S * (2 * AHEAD_S + rig.stage._between_s) + BUSY_M


@each
@pytest.mark.parametrize("fault", ["ignores stop", "ignores stops"])
def test_where_a_stop_is_not_obeyed_the_next_means_is(
    name: str, fault: str, winkler: Respond
) -> None:
    """In a lift, of which the controller knows all: 30 mm in 6 s. And it lifts afterwards."""
    with rig_of(name, winkler) as rig:
        enable(rig.stage)
        rig.stage.move(TOP._replace(z=0.032), 5e-3)
        rig.wait_for(lambda: tip_m(rig) > 3e-3)
        rig.served.fail(fault)
        *deaf, heard = rig.stage.stop_means()[: 2 + (fault == "ignores stops")]
        for means in deaf:
            means.call()
            time.sleep(0.3)
            assert rig.phantom.tip.moving(rig.phantom.clock.now())
        heard.call()
        began_s = time.monotonic()
        still_m(rig)
        assert time.monotonic() - began_s < heard.within_s + 0.4
        rig.wait_for(lambda: not rig.stage.moving())
        top = rig.stage.pose()._replace(z=tip_m(rig) + 2e-3)
        rig.stage.move(top, 5e-3)
        rig.arrive()
        assert tip_m(rig) == pytest.approx(top.z, abs=5e-6)


@pytest.mark.parametrize("exchange_s", [0.001, 0.004])
@each
def test_a_ramp_that_is_led_has_no_ripple(
    name: str, exchange_s: float, winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The force as the emulator's side has it; an exchange takes what it does at 115200 or 38400
    baud, and between two readings there are 10 ms."""
    clock = SimulatedClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=(0.032, 0.0, 0.0))
    device: Any = {"zaber": lambda c: zaber.ZaberChain(c, check_sums=True),
                   "pi": lambda c: pi.PiController(c, servo=True),
                   "tmcl": tmcl.TmclModule}[name](Carriage(phantom, homed=True))  # fmt: skip

    class Line:
        def ask(self, data: bytes, *, end: bytes = b"", **_how: Any) -> bytes:
            clock.sleep_until(clock.now() + exchange_s)
            answer = b"".join(device.received(bytes([byte])) for byte in data)
            return answer.removesuffix(end) if end else answer

        def say(self, data: bytes) -> None:
            device.received(data)

    for module in (f"drivers.{name}.Line", "drivers.tmcl.time", "drivers.core.leading.time"):
        stands_in: Any = SimpleNamespace(monotonic=clock.now)
        monkeypatch.setattr(module, (lambda *_: Line()) if module.endswith("Line") else stands_in)
    module = import_module(f"drivers.{name}")
    keys = {"port": "pty", "z": EMULATORS[name].RIG_AXES["z"]}
    axes = getattr(module, f"{name.title()}Axes")(
        getattr(module, f"{name.title()}Settings")(**keys)
    )
    origin_mm = dict(zip("xyz", EMULATORS[name].RIG_ORIGIN_MM, strict=True))
    speed_mm_s = 1e3 * PRESS_M_S
    way = SegmentedMove((0.0,) * 3, (0.0, 0.0, -2.4), speed_mm_s, ahead_mm=AHEAD_S * speed_mm_s)
    lead = Lead(way, "z", origin_mm, 0.05)
    lead.set_off(axes)
    began_s = clock.now()
    while clock.now() < began_s + 2.5:
        lead.go_on(axes, axes.read(), None)
        clock.sleep_until(clock.now() + 0.01)
    assert not lead.trouble
    assert phantom.tip.point(clock.now())[2] == pytest.approx(-2.4e-3, abs=1e-6)
    times = began_s + np.arange(0.01, 1.98, 1e-3)
    force = phantom.force_n(times)
    even = np.interp(times, times[[0, -1]], force[[0, -1]])
    assert np.abs(force - even).max() < 2e-4 * force[-1]  # a speed is a whole number of steps
