"""A press that nobody feels, by the true way of the tip over a bed of springs."""

from typing import Any

import numpy as np
import pytest
from springs import Ran, SpringSensor, on_simulated_springs, run_springs, spring_rig

from probe.core.events import Finish

HALF_WAY_M = 1.25e-3  # of the rig's press of 2.5 mm
STOPPING_M = 0.05e-3  # poses and stops at 2.5 mm/s


class Deaf(SpringSensor):
    """Its own noise and nothing else."""

    noise_n = 0.5e-3

    def raw(self, _time_s: float) -> float:
        return self.noise_n * float(self._rng.standard_normal())


class DeafAndNoisy(Deaf):
    """Ten times its noise is 3 % of the limit: soft tissue may hide in that."""

    noise_n = 5e-3


class Noisy(SpringSensor):
    def raw(self, time_s: float) -> float:
        return self.bed.force_n(time_s) + 5e-3 * float(self._rng.standard_normal())


def press(sensors: list[type[SpringSensor]], surface_mm: float = 0.0, **tables: Any) -> Ran:
    bed, stage, _ = on_simulated_springs(surface_m=1e-3 * surface_mm)
    return run_springs(
        bed, stage, [sensor(bed, name=f"cell {n}") for n, sensor in enumerate(sensors)],
        rig=spring_rig(**tables),
    )  # fmt: skip


@pytest.mark.parametrize("sensors", [[Deaf], [DeafAndNoisy, Deaf]])
def test_a_press_that_is_not_felt_half_way_down_ends_there(sensors: list[Any]) -> None:
    ran = press(sensors)
    assert ran.finish is Finish.FAULTED
    assert "no force above the noise" in ran.reason
    assert "safety.contact_within_mm" in ran.reason
    assert HALF_WAY_M < -ran.height_m.min() < HALF_WAY_M + STOPPING_M
    assert ran.lifted


def test_a_press_that_is_not_felt_on_a_slope_ends_by_the_surface_there() -> None:
    slope = [[0, 0, 0], [60, 0, 6], [0, 5, 0]]
    ran = press([Deaf], -9.0, scan={"start_mm": 30.0, "surface_mm": slope})
    assert "no force above the noise" in ran.reason
    assert 3e-3 - 2e-3 < ran.height_m.min() < 3e-3


def test_one_sensor_that_feels_the_press_is_enough() -> None:
    assert press([SpringSensor, Deaf]).complete == [0]


@pytest.mark.parametrize(("within_mm", "complete"), [(2.0, [0]), (None, [])])
def test_a_surface_may_be_as_low_as_the_rig_file_allows(
    within_mm: float | None, complete: list[int]
) -> None:
    assert press([SpringSensor], -1.6, safety={"contact_within_mm": within_mm}).complete == complete


def test_a_surface_that_is_searched_may_be_low() -> None:
    scan = {"touch_n": 0.05, "search_mm": 1.5}
    ran = press([SpringSensor], -1.3, scan=scan, safety={"max_depth_mm": 6.0})
    assert ran.complete == [0]
    assert np.isclose(-ran.height_m.min(), 1.3e-3 + 2.5e-3, atol=0.3e-3)


def test_what_noise_hides_of_little_tissue_is_not_asked_for() -> None:
    assert press([Noisy], -1.6).complete == [0]
