"""Uncertainty of the heights and places of a row's bumps."""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.bump_fit import NARROWEST, refined, widest_m
from probe.detection.map.row_shapes import OTHER_TAILS, slopes, weighted
from probe.detection.repeats import pitch_m

MAX_LOG_ODDS = 10.0
"""Beyond these another shape is the only one."""


def doubts(
    x_m: Array, sd: Array, fitted: Array, known: list[tuple[float, float]], heights: Array,
    scatter: float, fixed: bool,
) -> tuple[Array, Array]:  # fmt: skip
    """Standard deviations (k,) of heights and of places. Columns ``fitted`` are of the base and all
    heights; unless ``fixed``, places and widths are as unknown: a wider bump may be higher."""
    n, count, each = len(x_m), fitted.shape[1], len(known)
    half = np.array([w for _, w in known])
    whole = np.zeros((len(fitted) + each, count + 2 * each))
    whole[: len(fitted), :count] = fitted
    if known and not fixed:
        moved = np.array([h * slopes(x_m, *one) for one, h in zip(known, heights, strict=True)])
        whole[:n, count : count + each] = (half[:, None] * moved[:, :, 0] / sd).T
        whole[:n, count + each :] = (moved[:, :, 1] / sd).T
        whole[len(fitted) :, count + each :] = np.eye(each) * np.sqrt(scatter) / _width_sd(x_m)
    spread = np.sqrt(scatter * np.diag(np.linalg.pinv(whole.T @ whole)))
    return spread[count - each : count], half * spread[count : count + each]


def _width_sd(x_m: Array) -> float:
    """Of the logarithm of a half width, any that is fitted as likely."""
    pitch = pitch_m(x_m)
    return float(np.log(widest_m(pitch, float(np.ptp(x_m))) / (NARROWEST * pitch)) / np.sqrt(12))


def other_shapes_sd_m(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]],
    rss: float, scatter: float, rising: bool,
) -> Array:  # fmt: skip
    """By how much (k,) the places [m] of ``known`` bumps, which leave the sum of squares ``rss``,
    move with bumps of `OTHER_TAILS`, each weighted by its likelihood beside theirs.

    What a bump looks like between its stations is not known. Where few stations show it, its place
    depends on that: of 40 Gaussian ones among stations of 8 mm, 8 lie in their intervals without
    this, and 39 with it.
    """
    own = np.array([c for c, _ in known])
    weight, square = 1.0, np.zeros(len(known))
    for tail in OTHER_TAILS:
        other = refined(x_m, value, sd, base, known, rising, tail)
        *_, left = weighted(x_m, value, sd, base, other, tail)
        odds = (rss - float(left @ left)) / (2 * max(scatter, 1.0))
        likelihood = float(np.exp(min(odds, MAX_LOG_ODDS)))
        weight += likelihood
        square += likelihood * (np.array([c for c, _ in other]) - own) ** 2
    return np.asarray(np.sqrt(square / weight))
