"""Smooth curves through a few points, with slopes where they are known.

(Not scipy.interpolate: importing it takes as long as a press.)
"""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array


@dataclass(frozen=True)
class HermiteCurve:
    """Piecewise cubic through ``y`` (n,) with slopes ``slope`` (n,) at increasing ``x`` (n,);
    beyond the ends it goes on as the end pieces do."""

    x: Array
    y: Array
    slope: Array

    def __call__(self, at: Array) -> Array:
        k = np.searchsorted(self.x[1:-1], at, side="right")
        width = self.x[k + 1] - self.x[k]
        t = (at - self.x[k]) / width
        s = 1 - t
        return np.asarray(
            s * s * ((1 + 2 * t) * self.y[k] + t * width * self.slope[k])
            + t * t * ((1 + 2 * s) * self.y[k + 1] - s * width * self.slope[k + 1])
        )


def from_nothing(x: Array, y: Array, slope: Array) -> HermiteCurve:
    """Through 0 at 0 and ``y`` (n,) with ``slope`` (n,) at ``x`` (n,) > 0. The first piece is as
    near to a parabola as its end allows without turning."""
    begins = np.clip(2 * y[0] / x[0] - slope[0], *np.sort([0.0, 3 * y[0] / x[0]]))
    return HermiteCurve(
        np.concatenate([[0.0], x]), np.concatenate([[0.0], y]), np.concatenate([[begins], slope])
    )


def monotone(x: Array, y: Array) -> HermiteCurve:
    """Through ``y`` (n,) at ``x`` (n,) with slopes that do not overshoot (Fritsch and Butland 1984,
    A method for constructing local monotone piecewise cubic interpolants, eq. 4)."""
    width, secant = np.diff(x), np.diff(y) / np.diff(x)
    slope = np.zeros_like(y)
    before, after = secant[:-1], secant[1:]
    share = (width[:-1] + 2 * width[1:]) / (3 * (width[:-1] + width[1:]))
    same = before * after > 0
    mean = share[same] * after[same] + (1 - share[same]) * before[same]
    slope[1:-1][same] = before[same] * after[same] / mean
    slope[0], slope[-1] = secant[0], secant[-1]
    return HermiteCurve(x, y, slope)
