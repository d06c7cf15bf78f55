"""What neighbouring holds say together: chi-squares add up, and chances are those of their sum."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from probe.detection.pulse.noise import WHITE
from probe.detection.pulse.pooled_evidence import shared_chance
from probe.detection.pulse.possible_rates import anywhere, weights
from probe.detection.pulse.search import Search

RATES_HZ = np.linspace(0.7, 3.0, 40)
SPAN_S = 5.0


def search_with(clear: float) -> Search:
    """A hold in which one rate explains ``clear``, as a chi-square, and the others little."""
    values = np.full(len(RATES_HZ), 1.0)
    values[17] = clear
    none = np.zeros((1, len(RATES_HZ), 4))
    return Search(
        RATES_HZ, np.zeros(1), none, none, values, values / 2, RATES_HZ[17], 1.0, SPAN_S, WHITE, 90
    )


@pytest.mark.parametrize("count", [1, 2, 5])
def test_equal_holds_add_up(count: int) -> None:
    """Fisher's sum: ``count`` holds of 9 are a chi-square of 9 ``count``, of two degrees each."""
    found = shared_chance([search_with(9.0)] * count, excess=1.0)
    one = float(chi2.sf(9.0 * count, 2 * count) / weights(RATES_HZ)[17])
    assert found == pytest.approx(anywhere(one, SPAN_S))


def test_noise_that_was_not_fitted_is_taken_off() -> None:
    pair = [search_with(20.0)] * 2
    assert shared_chance(pair, 2.0) > 100 * shared_chance(pair, 1.0)


def test_a_rate_that_differs_is_no_shared_one() -> None:
    other = search_with(20.0)
    moved = replace(other, clear=np.roll(other.clear, 9))
    assert shared_chance([other, moved], 1.0) > 1e3 * shared_chance([other, other], 1.0)
