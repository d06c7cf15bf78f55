"""Taxels that stand still at one end or the other, and good ones, of which nothing is said."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration import TaxelCalibration, fit_taxels, load, record, restore, save

LEVELS_PA = 1e3 * np.array([0, 2, 4, 6, 8, 10, 15, 20])
PRESSURE_PA = np.repeat(LEVELS_PA, 3)


def array(seed: int, sign: int = 1, step: float = 0.0, **end: Any) -> tuple[np.ndarray, np.ndarray]:
    """Nine taxels' readings and sensitivities; ``end``: how they are cut, as of `numpy.clip`."""
    rng = np.random.default_rng(seed)
    gain = 0.01 * sign * (1 + 0.2 * rng.standard_normal(9))
    zero = 20 + 5 * rng.standard_normal(9) + (400 if sign < 0 else 0)
    noise = 0.5 * rng.standard_normal((len(PRESSURE_PA), 9))
    raw = np.clip(zero + np.outer(PRESSURE_PA, gain) + noise, **({"min": None, "max": None} | end))
    return (np.round(raw / step) * step if step else raw), gain


@pytest.mark.parametrize("sign, end, seen", [
    (1, {"min": 60}, ("floor", "dead_zone_pa")),
    (1, {"max": 150}, ("ceiling", "clips_pa")),
    (-1, {"max": 380}, ("ceiling", "dead_zone_pa")),
    (-1, {"min": 280}, ("floor", "clips_pa")),
    (1, {"min": 60, "max": 150}, ("floor", "dead_zone_pa")),
])  # fmt: skip
@pytest.mark.parametrize("step", [0.0, 2.0])
def test_readings_that_stand_still_are_left_out(
    sign: int, end: dict[str, float], seen: tuple[str, str], step: float
) -> None:
    off, inside, said = [], [], []
    for seed in range(40):
        raw, gain = array(seed, sign, step, **end)
        found = fit_taxels(raw, PRESSURE_PA)
        low, high = found.fit.interval()[1::2].T
        off.append(np.abs(1 / found.gain / gain - 1))
        inside.append((low <= gain) & (gain <= high))
        cut = np.mean(raw == getattr(found, seen[0]), axis=0)
        said.append(np.isfinite(getattr(found, seen[0])) & (cut > 0.1))
        at_pa = getattr(found, seen[1])
        assert np.nanmax(np.abs(at_pa - np.nanmedian(at_pa))) < 8e3
    assert np.nanmedian(off) < 0.01
    assert np.mean(inside) > (0.8 if step else 0.92)  # what a step rounds off is not independent
    assert np.mean(said) > 0.85


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("step", [0.0, 2.0, 5.0, 20.0])
def test_of_good_taxels_nothing_is_said(sign: int, step: float) -> None:
    for seed in range(40):
        found = fit_taxels(array(seed, sign, step)[0], PRESSURE_PA)
        assert np.isnan([found.floor, found.ceiling]).all()
        assert not found.bent.any()


def test_noise_over_a_dead_zone_leaves_a_bend() -> None:
    raw, _ = array(1, min=60)
    noise = 0.5 * np.random.default_rng(2).standard_normal(raw.shape)
    assert (fit_taxels(raw + noise, PRESSURE_PA).bent > 0.02).all()


def test_a_file_from_before_the_floor_is_read(tmp_path: Path) -> None:
    file, raw = tmp_path / "t.json", array(1, max=150)[0]
    found = fit_taxels(raw, PRESSURE_PA)
    save(record(found, "array", {}), file)
    table = json.loads(file.read_text())
    del table["values"]["floor"], table["values"]["bent"]
    file.write_text(json.dumps(table))
    old = restore(load(file))
    assert isinstance(old, TaxelCalibration)
    assert old.span == pytest.approx(found.span, nan_ok=True)
    assert (old.saturated(raw) == found.saturated(raw)).all()


def test_a_scan_counts_from_the_reading_at_rest() -> None:
    """A tare takes the floor off: 90 are left to the ceiling, though the line begins at 20."""
    raw, _ = array(3, min=60, max=150)
    span = fit_taxels(raw, PRESSURE_PA).span
    assert span[np.isfinite(span)] == pytest.approx(90)
    falling = fit_taxels(array(3, -1, min=280)[0], PRESSURE_PA).span
    assert (falling[np.isfinite(falling)] < 0).all()
