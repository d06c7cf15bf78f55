"""Places of things that the probe squeezes aside."""

import numpy as np
import pytest
from known_presses import recording, row

from probe.detection import detect
from probe.detection.map.sideways import NEAR_MIDDLE, SQUEEZED, reach_inwards_m

ROW_M = 1e-3 * 4.0 * np.arange(1, 16)  # of a block from 0 to 64 mm
DEPTH_M = 2.5e-3


@pytest.mark.parametrize("felt_mm", [18.0, 46.0])
def test_the_interval_holds_the_place_before_it_was_squeezed_outwards(felt_mm: float) -> None:
    """By half of the depth: what whole blocks that slide do at their median."""
    rng = np.random.default_rng(8)
    true_mm = felt_mm + 0.5 * 2.5 * np.sign(32.0 - felt_mm)
    found = detect(recording(row(rng, centre_mm=felt_mm, bump=0.25, noise_pa=5.0, scatter=0.001)))
    (one,) = found.objects
    low_mm, high_mm = (1e3 * end for end in one.position_ci_m)
    assert low_mm <= true_mm <= high_mm
    assert high_mm - low_mm < 4.0


def test_no_interval_grows_in_the_middle_or_for_want_of_a_depth() -> None:
    assert reach_inwards_m(32e-3, ROW_M, DEPTH_M) == pytest.approx(0.0, abs=1e-9)
    assert reach_inwards_m(12e-3, ROW_M, 0.0) == 0.0


def test_it_reaches_inwards_from_both_sides_and_no_further_near_the_ends() -> None:
    whole = SQUEEZED * DEPTH_M
    assert reach_inwards_m(10e-3, ROW_M, DEPTH_M) == pytest.approx(whole)
    assert reach_inwards_m(54e-3, ROW_M, DEPTH_M) == pytest.approx(-whole)
    near = reach_inwards_m(32e-3 + 0.5 * NEAR_MIDDLE * 32e-3, ROW_M, DEPTH_M)
    assert near == pytest.approx(-whole / 2)
