"""How the chance of a false pulse is shared out over the rates that hearts have."""

import numpy as np
import pytest
from known_presses import station
from scipy.special import chdtrc

from probe.detection.pulse.hold_samples import hold_of
from probe.detection.pulse.possible_rates import FASTEST_HZ, SLOWEST_HZ, anywhere, rates_hz, weights
from probe.detection.pulse.search import SHARE, search


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


@pytest.mark.parametrize("rate_hz", [1.2, 2.6])
def test_a_search_spends_more_of_the_chance_on_resting_hearts(rate_hz: float) -> None:
    """A steady pulse of the known shape, whose chance follows from how clear it is at its rate."""
    rng = np.random.default_rng(7)
    found, _ = search(hold_of(station(rng, pulse_pa=12.0, rate_hz=rate_hz)))
    at = int(np.argmax(found.clear))
    assert found.rates_hz[at] == pytest.approx(rate_hz, abs=0.1)
    assert 1e-30 < found.p_value < 1e-3
    one = chdtrc(2, found.clear[at]) / weights(found.rates_hz)[at]
    assert found.p_value == pytest.approx(
        anywhere(one, found.span_s) / SHARE["shaped"], rel=0.02, abs=0
    )


def test_a_short_hold_without_a_pulse_passes_as_often_as_its_chance_says() -> None:
    """Of 25 samples, in which level, drift and relaxation take much of what slow rates tell."""
    rng = np.random.default_rng(1)
    holds = [hold_of(station(rng, hold_s=2.5, sample_hz=10.0)) for _ in range(500)]
    assert np.mean([search(hold)[0].p_value < 0.3 for hold in holds]) == pytest.approx(
        0.3, abs=0.06
    )
