"""An emulated UR in a phantom, and the drivers for it."""

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

import pytest

from drivers import DeviceFault, WallClock
from drivers.testing.awake import AwakeTime
from drivers.ur.sensor import UrForce, open_sensor
from drivers.ur.settings import UrSensorSettings, UrStageSettings
from drivers.ur.stage import UrStage, open_stage
from sim_backend import load_scene
from sim_backend.emulators import ur
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


def lowest_m(phantom: Phantom) -> float:
    legs = phantom.tip.all_legs()
    ends_s = [*(leg.start_s for leg in legs[1:]), math.inf]
    return min(leg.point(end_s)[2] for leg, end_s in zip(legs, ends_s, strict=True))


class Rig:
    """A phantom, and a stage and a sensor for a robot in it; not connected."""

    def __init__(
        self, respond: Respond, host: str, surface: Surface = lambda _x, _y: 0.0, **keys: Any
    ) -> None:
        self.clock = WallClock()
        self.host = host
        home = (0.03, 0.0, 0.004)
        scene = load_scene("TIHA")
        self.phantom = Phantom(scene, self.clock, respond, surface=surface, home=home)
        usual = {
            "host": host,
            "origin_mm": ORIGIN_MM,
            "silence_s": PATIENT_S,
            "watchdog_s": PATIENT_S,
            "answer_s": PATIENT_S,
        }
        stage = UrStageSettings(**(usual | keys))
        self.stage: UrStage = open_stage(self.clock, stage)
        self.sensor: UrForce = open_sensor(
            self.clock, UrSensorSettings(host=host, silence_s=PATIENT_S)
        )

    @property
    def deepest_m(self) -> float:
        """The lowest that the tip has been."""
        return lowest_m(self.phantom)

    def arrive(self, timeout_s: float = 3.0) -> None:
        with AwakeTime() as awake:
            end = awake.now() + timeout_s
            while self.stage.moving():
                assert awake.now() < end
                time.sleep(0.003)

    def trouble(self) -> str:
        """What the stage says is wrong; empty while it gives its pose."""
        try:
            self.stage.pose()
        except DeviceFault as fault:
            return str(fault)
        return ""

    def close(self) -> None:
        self.sensor.close()
        self.stage.close()


def until(true: Callable[[], bool]) -> None:
    """Wait for it, not for ever."""
    end_s = time.monotonic() + 20.0
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.0005)


def until_said(made: Rig, words: str) -> None:
    """Until the driver says that this is wrong."""
    until(lambda: words in made.trouble())


@contextmanager
def connected(
    respond: Respond, *, surface: Surface = lambda _x, _y: 0.0, keys: dict[str, Any] | None = None,
    **emulated: Any,
) -> Iterator[tuple[Rig, ur.UrController]]:  # fmt: skip
    """Both, connected for reading. ``emulated``: of `sim_backend.emulators.ur.emulate`."""
    made = Rig(respond, fresh_host(), surface, **(keys or {}))
    settings = {"origin_mm": ORIGIN_MM, "noise_n": 0.001, **emulated}
    with ur.emulate(made.phantom, at=made.host, **settings) as robot:
        try:
            made.stage.connect()
            made.sensor.connect()
            yield made, robot
        finally:
            made.close()
