"""Bumps of a row: how many stations it takes to show one."""

import numpy as np
import pytest

from probe.detection.map.bumps import find_bumps, floor, shape

HEIGHT, NOISE = 1.0, 1e-3


@pytest.mark.parametrize(("stations", "found"), [(3, 0), (5, 0), (7, 1), (15, 1)])
def test_fewer_than_six_stations_show_no_bump(stations: int, found: int) -> None:
    rng = np.random.default_rng(stations)
    x_m = 4e-3 * np.arange(stations)
    value = HEIGHT * shape(x_m, float(x_m[stations // 2]), 4e-3) + NOISE * rng.normal(size=stations)
    row = find_bumps(x_m, value, np.full(stations, NOISE), floor(x_m), 0.01)
    assert len(row.bumps) == found
    for bump in row.bumps:
        assert bump.x_m == pytest.approx(x_m[stations // 2], abs=0.5e-3)
