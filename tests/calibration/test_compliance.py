"""A rig that gives way out of proportion to its load: by how much; a straight one does not."""

import json
from pathlib import Path

import numpy as np
import pytest

from calibration import ComplianceCalibration, fit_compliance, load, record, restore, save


def pressed(seed: int, bend_mm: float, first_mm: float = -1.0, count: int = 200) -> np.ndarray:
    """Travel [m] and force [N] of 2 N/mm at the touch, which grows by 2 ``bend_mm`` per mm."""
    travel = np.linspace(first_mm, 2.0, count)
    way = np.maximum(travel, 0)
    noise = 5e-3 * np.random.default_rng(seed).standard_normal(count)
    return np.array([1e-3 * travel, 0.03 + 2 * way * (1 + bend_mm * way) + noise])


@pytest.mark.parametrize("first_mm", [-1.0, 0.01])
@pytest.mark.parametrize("bend_mm", [0.15, 0.05, -0.1])
def test_a_bend_is_measured(bend_mm: float, first_mm: float) -> None:
    for seed in range(10):
        found = fit_compliance(*pressed(seed, bend_mm, first_mm))
        assert found.stiffness_start_n_m == pytest.approx(2000, rel=0.02)
        assert found.stiffness_end_n_m == pytest.approx(2000 * (1 + 4 * bend_mm), rel=0.02)
        assert found.bend == pytest.approx(8000 * bend_mm / found.stiffness_n_m, rel=0.1)


def test_depths_are_off_by_what_the_bend_takes() -> None:
    """2 mm at 5.2 N: 2.6 N/mm would give way by 2 mm too, but by 0.1 mm less at 1 mm (2.3 N)."""
    found = ComplianceCalibration(2600, 0, 5.2, 0, 2000, 3200, fit_compliance(*pressed(1, 0)).fit)
    assert found.depth_off_m == pytest.approx(1e-3 * (1 - 2.3 / 2.6), rel=0.01)


@pytest.mark.parametrize("count", [8, 30, 200])
def test_a_straight_rig_has_none(count: int) -> None:
    said = [fit_compliance(*pressed(seed, 0.0, count=count)).bend != 0 for seed in range(100)]
    assert np.mean(said) <= 0.01


def test_a_file_from_before_the_bend_is_read(tmp_path: Path) -> None:
    file, found = tmp_path / "c.json", fit_compliance(*pressed(1, 0.15))
    save(record(found, "stage", {}), file)
    table = json.loads(file.read_text())
    assert table["values"]["stiffness_end_n_m"]["value"] == found.stiffness_end_n_m
    for name in ComplianceCalibration.ADDED:
        del table["values"][name]
    file.write_text(json.dumps(table))
    old = restore(load(file))
    assert isinstance(old, ComplianceCalibration)
    assert old.stiffness_n_m == found.stiffness_n_m
    assert np.isnan(old.stiffness_end_n_m)
