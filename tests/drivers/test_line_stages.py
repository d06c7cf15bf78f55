"""Zaber, PI and TMCL against emulated controllers: what each says is understood in its words. What
every stage does with nobody there GRBL does too."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest
from true_tip import HasTip
from waiting import until

import drivers.pi
import drivers.zaber
from drivers import DeviceFault, MotionFault, Pose, WallClock
from drivers.core.abilities import enable
from drivers.core.errors import ConfigError
from drivers.core.line_stage import LineStage
from drivers.core.registry import open_driver
from drivers.core.segments import AHEAD_S
from sim_backend import load_scene
from sim_backend.emulators import grbl, pi, tmcl, zaber
from sim_backend.emulators.serving import Served
from sim_backend.phantom.phantom import Phantom, Respond

EMULATORS: dict[str, Any] = {"zaber": zaber, "pi": pi, "tmcl": tmcl}
HOME = (0.032, 0.0, 0.002)
GRBL_BETWEEN_S = 0.01
TOP, BOTTOM = Pose(*HOME), Pose(0.032, 0.0, -0.0024)
PRESS_M_S = 1.2e-3
BUSY_M = 0.1e-3  # 80 ms in which a busy machine looks late at what has happened
PATIENT = {"silent_s": 2.0, "answer_s": 1.0}  # the emulator shares this machine with other tests


@dataclass
class Rig(HasTip):
    """A stage, and the phantom with its tip."""

    stage: LineStage
    served: Served
    phantom: Phantom

    def arrive(self) -> None:
        until(lambda: not self.stage.moving(), 5.0)

    def go(self, target: Pose, speed_m_s: float) -> None:
        self.stage.move(target, speed_m_s)
        self.arrive()

    def press(self) -> float:
        """Half a millimetre deep, which it returns [m]."""
        enable(self.stage)
        self.stage.move(BOTTOM, PRESS_M_S)
        until(lambda: self.tip_m[2] < -0.5e-3, 5.0)
        return self.tip_m[2]


@contextmanager
def rig_of(name: str, winkler: Respond, *, homed: bool = True, **keys: Any) -> Iterator[Rig]:
    clock = WallClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=HOME)
    emulator = EMULATORS.get(name, grbl)
    with emulator.emulate(phantom, homed=homed) as served:
        if name == "grbl":
            usual = {"origin_mm": grbl.ORIGIN_MM, "status_hz": 1 / GRBL_BETWEEN_S, **PATIENT}
        else:
            usual = {**emulator.RIG_AXES, "origin_mm": emulator.RIG_ORIGIN_MM, **PATIENT}
        stage = open_driver("stages", name, clock, {**usual, "port": served.address, **keys})
        try:
            stage.connect()
            yield Rig(stage, served, phantom)
        finally:
            stage.close()


@pytest.fixture
def rig(name: str, winkler: Respond) -> Iterator[Rig]:
    with rig_of(name, winkler) as made:
        yield made


each = pytest.mark.parametrize("name", EMULATORS)
each_and_grbl = pytest.mark.parametrize("name", [*EMULATORS, "grbl"])


@each
def test_it_moves_all_axes_in_the_scan_frame_and_they_arrive_together(rig: Rig) -> None:
    enable(rig.stage)
    assert rig.stage.pose()[:3] == pytest.approx(HOME, abs=1e-6)
    target = Pose(0.036, -0.002, 0.006)
    rig.go(target, 8e-3)
    assert rig.stage.pose()[:3] == pytest.approx(target[:3], abs=2e-6)
    assert rig.tip_m == pytest.approx(target[:3], abs=2e-6)
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
            while not rig.tip_moves:
                pass
            rig.stage.stop()

        stopper = threading.Thread(target=stop)
        stopper.start()
        with pytest.raises(DeviceFault, match="stopped on the way"):
            rig.stage.home()
        stopper.join()
        assert rig.tip_m[2] < 0.038


FAULTS = [
    ("zaber", "stall", "stalled and stopped", MotionFault, "lifts"),
    ("zaber", "driver off", "driver is disabled", MotionFault, ""),
    ("zaber", "restart", "lost its reference", DeviceFault, ""),
    ("pi", "motion error", "servo was switched off", MotionFault, ""),
    ("tmcl", "limit switch", "left limit switch", MotionFault, "lifts"),
    ("tmcl", "restart", "has restarted", DeviceFault, ""),
]


@pytest.mark.parametrize(("name", "fault", "words", "kind", "then"), FAULTS, ids=lambda v: str(v))
def test_a_fault_is_reported_in_its_words(
    fault: str, words: str, kind: type[DeviceFault], then: str, rig: Rig
) -> None:
    """After one of motion that leaves the axis its power it lifts."""
    enable(rig.stage)
    rig.stage.move(Pose(*HOME)._replace(z=-0.002), 1e-3)
    until(lambda: rig.stage.pose().z < 0.0019, 5.0)
    rig.served.fail(fault)
    with pytest.raises(kind, match=words):
        rig.arrive()
    if then == "lifts":
        rig.go(Pose(*HOME), 5e-3)
        assert rig.stage.pose().z == pytest.approx(HOME[2], abs=2e-6)


@each
def test_what_a_controller_refuses_is_said(name: str, rig: Rig) -> None:
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


def between_s(rig: Rig) -> float:
    return getattr(rig.stage, "_between_s", GRBL_BETWEEN_S)


@each_and_grbl
def test_a_controller_that_is_left_alone_comes_to_rest(rig: Rig) -> None:
    """The plug is pulled, or everything that could send dies."""
    before_m = rig.press()
    bound_m = PRESS_M_S * (AHEAD_S + between_s(rig) + 0.01)
    rig.served.fail("drop")
    assert before_m - rig.rests_m() < bound_m + BUSY_M


@each_and_grbl
def test_a_lift_is_finished_with_nobody_there(rig: Rig) -> None:
    rig.press()
    rig.stage.stop()
    rig.arrive()
    rig.stage.move(TOP, PRESS_M_S)
    until(lambda: rig.tip_m[2] > 0.0, 5.0)
    rig.served.fail("drop")
    assert rig.rests_m() == pytest.approx(TOP.z, abs=5e-6)


@each_and_grbl
def test_a_press_is_not_gone_on_with_when_nobody_checks_the_force(rig: Rig) -> None:
    enable(rig.stage)
    rig.stage.move(BOTTOM, PRESS_M_S)
    while rig.tip_m[2] > -0.5e-3:
        rig.stage.keep_alive()
        time.sleep(1e-3)
    before_m = rig.tip_m[2]
    rests_m = rig.rests_m()
    assert before_m - rests_m < PRESS_M_S * (2 * AHEAD_S + between_s(rig)) + BUSY_M
    rig.stage.keep_alive()
    until(lambda: rig.tip_m[2] < rests_m, 5.0)


@each
@pytest.mark.parametrize("fault", ["ignores stop", "ignores stops"])
def test_where_a_stop_is_not_obeyed_the_next_means_is(fault: str, rig: Rig) -> None:
    """In a lift, of which the controller knows all: 30 mm in 6 s. And it lifts afterwards."""
    enable(rig.stage)
    rig.stage.move(TOP._replace(z=0.032), 5e-3)
    until(lambda: rig.tip_m[2] > 3e-3, 5.0)
    rig.served.fail(fault)
    *deaf, heard = rig.stage.stop_means()[: 2 + (fault == "ignores stops")]
    for means in deaf:
        means.call()
        time.sleep(0.3)
        assert rig.tip_moves
    heard.call()
    began_s = time.monotonic()
    rig.rests_m()
    assert time.monotonic() - began_s < heard.within_s + 0.4
    rig.arrive()
    top = rig.stage.pose()._replace(z=rig.tip_m[2] + 2e-3)
    rig.go(top, 5e-3)
    assert rig.tip_m[2] == pytest.approx(top.z, abs=5e-6)
