"""A sensor's own low pass, found again from movements behind a known one."""

import numpy as np
import pytest
from slow_cells import taps

from calibration.errors import CalibrationError
from calibration.low_pass import fit_low_pass


@pytest.mark.parametrize(
    ("filter_s", "delay_s", "rate_hz"), [(0.5, 0.0, 80.0), (0.05, 0.02, 200.0), (0.12, 0.01, 100.0)]
)
def test_a_low_pass_is_found_beside_a_delay(
    filter_s: float, delay_s: float, rate_hz: float
) -> None:
    found = fit_low_pass(*taps(filter_s, delay_s, rate_hz, 5e-3, 1))
    assert found is not None
    assert found.filter_s == pytest.approx(filter_s, rel=0.03)
    assert found.delay_s == pytest.approx(delay_s, abs=6e-3)


@pytest.mark.parametrize("delay_s", [0.0, 0.03])
def test_a_delay_alone_is_no_low_pass(delay_s: float) -> None:
    assert fit_low_pass(*taps(0.0, delay_s, 200.0, 5e-3, 2)) is None


def test_what_does_not_move_shows_none() -> None:
    t = np.arange(100) / 100.0
    with pytest.raises(CalibrationError, match="no movement"):
        fit_low_pass(t, np.zeros(100), t, t)
