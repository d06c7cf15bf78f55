"""How the chance of a false pulse is shared out over the rates that hearts have."""

import numpy as np
import pytest

from probe.detection.pulse.rate_prior import FASTEST_HZ, SLOWEST_HZ, rates_hz, weights


@pytest.mark.parametrize("span_s", [2.25, 4.75, 30.0])
def test_the_whole_chance_is_kept(span_s: float) -> None:
    """Chances under p at each rate add up to what they do where all rates count the same."""
    assert weights(rates_hz(span_s)).mean() == pytest.approx(1.0, abs=0.03)


def test_no_rate_is_shut_out_and_a_resting_heart_is_looked_for_most() -> None:
    rates = np.linspace(SLOWEST_HZ, FASTEST_HZ, 50)
    weight = weights(rates)
    assert weight.min() >= 0.5
    assert 60 <= 60 * rates[np.argmax(weight)] <= 80
    assert weight.max() > 1.5
