"""Sensors that send fewer readings than the rig says."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from springs import SpringSensor, on_simulated_springs, run_springs, spring_rig

from drivers import Block
from probe.scan.sensor_rates import SensorRates

CELL: Any = SimpleNamespace(name="cell", rate_hz=100.0)


class Sparse(SpringSensor):
    """Sends one of ``every`` readings."""

    every = 10

    def block(self, time_s: Any, force: Any) -> Block:
        sent = np.round(np.asarray(time_s) * self.rate_hz) % self.every == 0
        return super().block(np.asarray(time_s)[sent], np.asarray(force)[sent])


@pytest.mark.parametrize(("every", "said"), [(1, 0), (10, 1)])
def test_a_sensor_slower_than_its_rig_says_is_noted_once(every: int, said: int) -> None:
    bed, stage, _ = on_simulated_springs()
    sensor = Sparse(bed)
    sensor.every = every
    ran = run_springs(bed, stage, [sensor], rig=spring_rig(scan={"stations": 3}))
    assert ran.reason == "every station is complete"
    slow = [text for text in ran.notes if "readings a second" in text]
    assert len(slow) == said
    if said:
        assert slow[0].startswith(f"gives {sensor.rate_hz / every:.3g} readings a second")
        assert f"rate_hz = {sensor.rate_hz:g}" in slow[0]


def read(count: int, span_s: float, lost: int = 0, jumped_s: float = 0.0) -> Block:
    values, from_s = np.zeros((count, 1)), 3.0 + 2 * jumped_s
    time_s = np.linspace(from_s, from_s + span_s, count)
    return Block(time_s, values, values.astype(bool), lost, jumped_s)


@pytest.mark.parametrize("count, lost, said", [
    (101, 0, []),
    (85, 0, []),
    (85, 15, []),
    (75, 0, [("cell", "gives 74 readings a second")]),
    (8, 92, [("cell", "or 92 of 100 readings were lost")]),
])  # fmt: skip
def test_what_does_not_come_is_slow_or_lost(
    count: int, lost: int, said: list[tuple[str, str]]
) -> None:
    """A line of 80 Hz that a rig calls one of 1000 Hz passed without a word: 92 % were lost."""
    rates = SensorRates([CELL])
    rates.add([("stage", read(2, 1.0)), ("cell", read(count, 1.0, lost))])
    found = rates.slow()
    assert [name for name, _ in found] == [name for name, _ in said]
    assert all(words in text for (_, text), (_, words) in zip(found, said, strict=True))
    assert ("lost" in str(found)) == (lost > 20)
    assert rates.slow() == []


def test_while_a_device_stands_still_it_is_not_slow() -> None:
    rates = SensorRates([CELL])
    rates.add([("cell", read(101, 1.0))])
    rates.add([("cell", read(101, 1.0, jumped_s=5.0))])
    assert rates.slow() == []
    rates.add([("cell", read(51, 1.0))])
    assert len(rates.slow()) == 1
