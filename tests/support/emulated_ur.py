"""An emulated UR in a phantom, and the drivers for it."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

import pytest
from true_tip import HasTip

from drivers import DeviceFault, Pose, WallClock
from drivers.testing.awake import AwakeTime
from drivers.ur.sensor import UrForce, open_sensor
from drivers.ur.settings import UrSensorSettings, UrStageSettings
from drivers.ur.stage import UrStage, open_stage
from sim_backend import load_scene
from sim_backend.emulators import ur
from sim_backend.emulators.ur.robot import Robot
from sim_backend.phantom.phantom import Phantom, Respond, Surface

pytest.importorskip(
    "rtde_control", reason="UR rigs are not tested: ur-rtde has no wheel for this Python"
)
ORIGIN_MM = (400.0, -20.0, 150.0)
PATIENT_S = 5.0  # the emulator shares this machine with other tests; what is silent has its own
_numbers = count(1)


def fresh_host() -> str:
    """An address that no other test process uses."""
    return f"127.{1 + os.getpid() % 250}.{os.getpid() // 250 % 250}.{next(_numbers)}"


class Arm(HasTip):
    """A phantom, and a stage and a sensor for the robot in it; not connected."""

    controller: ur.UrController
    """What a test makes fail; there once it is emulated."""

    def __init__(
        self, respond: Respond, host: str, surface: Surface = lambda _x, _y: 0.0, **keys: Any
    ) -> None:
        self.clock, self.host = WallClock(), host
        self.phantom = Phantom(
            load_scene("TIHA"), self.clock, respond, surface=surface, home=(0.03, 0.0, 0.004)
        )
        patient = dict.fromkeys(("silence_s", "watchdog_s", "answer_s"), PATIENT_S)
        stage = UrStageSettings(**({"host": host, "origin_mm": ORIGIN_MM} | patient | keys))
        self.stage: UrStage = open_stage(self.clock, stage)
        sensor = UrSensorSettings(host=host, silence_s=PATIENT_S)
        self.sensor: UrForce = open_sensor(self.clock, sensor)

    @property
    def robot(self) -> Robot:
        """The inside of the controller."""
        return self.controller.robot

    def fail(self, fault: str | None) -> None:
        self.controller.fail(fault)

    def arrive(self, timeout_s: float = PATIENT_S) -> None:
        with AwakeTime() as awake:
            end = awake.now() + timeout_s
            while self.stage.moving():
                assert awake.now() < end
                time.sleep(0.003)

    def go(self, target: Pose, speed_m_s: float) -> None:
        """Move and arrive."""
        self.stage.move(target, speed_m_s)
        self.arrive()

    def trouble(self) -> str:
        """What the stage says is wrong; empty while it gives its pose."""
        try:
            self.stage.pose()
        except DeviceFault as fault:
            return str(fault)
        return ""

    def until_said(self, words: str) -> None:
        """Until the driver says that this is wrong."""
        until(lambda: words in self.trouble())

    def close(self) -> None:
        self.sensor.close()
        self.stage.close()


def until(true: Callable[[], bool]) -> None:
    """Wait for it, not for ever."""
    end_s = time.monotonic() + 20.0
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.0005)


@contextmanager
def connected(
    respond: Respond, *, surface: Surface = lambda _x, _y: 0.0, keys: dict[str, Any] | None = None,
    **emulated: Any,
) -> Iterator[Arm]:  # fmt: skip
    """Connected for reading. ``emulated``: of `sim_backend.emulators.ur.emulate`."""
    made = Arm(respond, fresh_host(), surface, **(keys or {}))
    settings = {"origin_mm": ORIGIN_MM, "noise_n": 0.001, **emulated}
    with ur.emulate(made.phantom, at=made.host, **settings) as made.controller:
        try:
            made.stage.connect()
            made.sensor.connect()
            yield made
        finally:
            made.close()


def arm_with(**how: Any) -> pytest.MarkDecorator:
    """The fixture `arm` is `connected` so."""
    return pytest.mark.parametrize("arm", [how], indirect=True, ids=[""])
