"""What a calibration says of the use that is made of it."""

import numpy as np
import pytest

from calibration import fit_compliance, fit_tare


def test_a_soft_rig_is_told_to_go_further() -> None:
    """2 N/mm: under 2 N the tip is 1 mm less deep than the stage."""
    depth_m = np.linspace(-1e-3, 2e-3, 60)
    rig = fit_compliance(depth_m, 2000.0 * np.maximum(depth_m, 0.0))
    assert rig.command(np.array([2e-3]), np.array([2.0])) == pytest.approx([3e-3])
    assert rig.true_depth(np.array([3e-3]), np.array([2.0])) == pytest.approx([2e-3])


def test_a_tare_is_good_until_its_drift_exceeds_what_is_tolerated() -> None:
    """10 mN a minute: 20 mN after two minutes, a little earlier by the drift's own doubt."""
    time_s = np.arange(0, 60, 0.1)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(time_s))
    tare = fit_tare(time_s, (0.3 + 10e-3 / 60 * time_s + noise)[:, None])
    assert 110 < tare.good_for_s(20e-3) <= 121
    assert tare.good_for_s(10e-3) == pytest.approx(tare.good_for_s(20e-3) / 2)
