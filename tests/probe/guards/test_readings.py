"""What the guards have read: asked before anything was, and after."""

import numpy as np

from drivers import Block
from probe.guards.readings import Readings


def test_a_sensor_that_was_not_seen_yet_has_nothing_in() -> None:
    """An arm that takes a second to be made ready is asked before its first sample."""
    readings = Readings(["arm", "cell"])
    assert readings.all_in_s(5.0) == -np.inf
    readings.all_seen(1.0)
    value = np.zeros((1, 1))
    readings.take("cell", Block(np.array([3.0]), value, value.astype(bool)))
    assert readings.all_in_s(5.0) == 1.0
    assert Readings([]).all_in_s(5.0) == 5.0
