"""The heart's rate of a scan, and whether its interval holds it as often as it says."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from probe.detection.heart_rate import heart_rate
from probe.detection.pulse.possible_rates import RATE_VARIABILITY


def pressed(rng: np.random.Generator, beats: int = 16) -> Any:
    """A press under a heart of 72 a minute, whose beats' lengths vary as hearts' do."""
    lengths_s = (1 + RATE_VARIABILITY * rng.standard_normal(beats)) / 1.2
    hold_s = float(lengths_s.sum())
    pulse = SimpleNamespace(rate_hz=beats / hold_s, size_pa=300.0, size_sd_pa=0.3)
    return SimpleNamespace(pulsing=True, pulse=pulse, hold_s=hold_s)


def test_the_interval_holds_the_rate_in_95_of_100_scans() -> None:
    rng = np.random.default_rng(6)
    inside = []
    for _ in range(1000):
        found = heart_rate((pressed(rng), pressed(rng), pressed(rng)))
        assert found is not None
        inside.append(found[1] <= 72.0 <= found[2])
    assert 0.93 <= np.mean(inside) <= 0.97
