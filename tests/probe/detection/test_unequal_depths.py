"""Rows that are pressed to one force: what is stiffer lies where the press is less deep."""

import numpy as np
import pytest
from recordings import FACE_M2

from probe.core.recording import Recording, Station
from probe.detection.scan import detect

FORCE_PA, DEPTH_M = 5000.0, 1.6e-3
RATE_HZ, RAMP_S, HOLD_S = 200.0, 1.0, 1.5


def station(index: int, stiffer: float) -> Station:
    """A press to `FORCE_PA` on a place that is so much ``stiffer`` than where it takes
    `DEPTH_M`; a ball's force is as depth^1.2 in a block."""
    t = np.arange(0.0, RAMP_S + HOLD_S, 1 / RATE_HZ)
    depth_m = DEPTH_M * (1 + stiffer) ** (-1 / 1.2) * np.clip(t / RAMP_S, 0.0, 1.0)
    noise_pa = np.random.default_rng(index).normal(0.0, 5.0, len(t))
    signal_pa = FORCE_PA * (1 + stiffer) * (depth_m / DEPTH_M) ** 1.2 + noise_pa
    x_m = 4e-3 * (index + 1)
    return Station(
        index, x_m, 0.0, t + 10 * index, signal_pa[:, None], np.zeros((len(t), 1), bool),
        10.0 * index, 10.0 * index + RAMP_S, 10.0 * index + RAMP_S + HOLD_S, depth_m,
    )  # fmt: skip


def row(stiffer: float) -> Recording:
    """Over a lump at 32 mm."""
    near = [np.exp(-(((4.0 * (n + 1) - 32.0) / 6.0) ** 2)) for n in range(15)]
    stations = tuple(station(n, stiffer * by) for n, by in enumerate(near))
    return Recording(stations, ("virtual.force",), ("virtual.force",), FACE_M2)


def test_a_lump_is_found_by_its_depth_where_all_forces_are_equal() -> None:
    found = detect(row(0.15))
    (lump,) = found.objects
    assert lump.kind == "tumour"
    assert lump.position_m == pytest.approx(0.032, abs=1e-3)
    assert lump.peak_pa == pytest.approx(0.15 * FORCE_PA, rel=0.25)
    assert "1.42 to 1.60 mm deep, so stiffness is compared as if all were 1.60" in found.reason
    assert np.ptp([s.baseline_pa for s in found.stations]) < 10.0, "levels are what was read"


def test_even_tissue_at_equal_force_is_nothing_and_depths_are_not_mentioned() -> None:
    found = detect(row(0.0))
    assert found.finding in ("nothing", "cannot see")
    assert "mm deep" not in found.reason
