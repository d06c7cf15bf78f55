"""Curves through a few points."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from sim_backend.models.curve import HermiteCurve, from_nothing, monotone

X = np.array([0.3, 0.9, 1.4, 2.5])


def test_a_cubic_is_met_everywhere():
    y, slope = X**3 - X, 3 * X**2 - 1
    at = np.linspace(0.2, 2.6, 50)
    found = HermiteCurve(X, y, slope)(at)
    assert found == pytest.approx(at**3 - at)
    assert found == pytest.approx(CubicHermiteSpline(X, y, slope)(at))


@pytest.mark.parametrize("power", [1.0, 1.3, 2.0])
def test_what_begins_at_nothing_rises_from_there(power):
    curve = from_nothing(X, X**power, power * X ** (power - 1))
    at = np.linspace(0, 0.3, 30)
    assert curve(at) == pytest.approx(at**power, abs=0.03 * 0.3**power)
    assert (np.diff(curve(at)) > 0).all()


def test_slopes_that_are_not_known_do_not_overshoot():
    y = np.array([0.0, 0.1, 2.0, 2.05])
    at = np.linspace(X[0], X[-1], 200)
    found = monotone(X, y)(at)
    assert (np.diff(found) >= 0).all()
    inside = (at > X[1]) & (at < X[2])  # scipy's differs in the slopes of the ends only
    assert found[inside] == pytest.approx(PchipInterpolator(X, y)(at[inside]))
