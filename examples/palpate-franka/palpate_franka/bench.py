"""A stand-in for an arm, with the methods of panda-python that the driver uses."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from drivers.testing.contract import Bench

HOME_M = (0.4, 0.0, 0.12)
plugged = True


class StandIn:
    """It is where its controller's set point is."""

    def __init__(self) -> None:
        self.place = np.array(HOME_M)
        self.runs = False

    def get_position(self) -> np.ndarray:
        if not plugged:
            raise RuntimeError("libfranka: UDP receive: Timeout")
        return self.place

    def get_orientation(self) -> np.ndarray:
        return np.array([0.0, 0.0, 0.0, 1.0])

    def start_controller(self, controller: Any) -> None:
        controller.arm, self.runs = self, True

    def stop_controller(self) -> None:
        self.runs = False


class StandInController:
    """Has the arm follow at once."""

    arm: StandIn | None = None

    def set_control(self, position: np.ndarray, _orientation: np.ndarray) -> None:
        if self.arm is not None and self.arm.runs:
            self.arm.place = np.array(position)


_arm = StandIn()


def connect_stand_in(_host: str) -> tuple[StandIn, StandInController]:
    """As `palpate_franka.stage.connect_panda`."""
    _arm.get_position()
    return _arm, StandInController()


def _plug(there: bool) -> None:
    global plugged
    plugged = there


@contextmanager
def bench() -> Iterator[Bench]:
    """The contract's bench."""
    origin_mm = tuple(1e3 * v for v in HOME_M)
    settings = {"simulated": True, "origin_mm": origin_mm}
    yield Bench("franka", settings, lambda: _plug(False), lambda: _plug(True))
