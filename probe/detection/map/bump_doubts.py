"""Uncertainty of the heights and places of a map's bumps."""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.bump_fit import NARROWEST, refined, widest_m
from probe.detection.map.rivals import MAX_LOG_ODDS
from probe.detection.map.row_shapes import OTHER_TAILS
from probe.detection.map.seen_map import Map, slopes, weighted


def doubts(
    seen: Map, fitted: Array, known: list[Array], heights: Array, scatter: float, fixed: bool
) -> tuple[Array, Array]:
    """Standard deviations of heights (k,) and of places (k, d). Columns ``fitted`` are of the base
    and all heights; unless ``fixed``, places and widths are as unknown: a wider bump may be
    higher."""
    n, count, each = len(seen.value), fitted.shape[1], len(known)
    half = np.array([one[-1] for one in known])
    widths = count + each * seen.axes
    whole = np.zeros((len(fitted) + each, widths + each))
    whole[: len(fitted), :count] = fitted
    if known and not fixed:
        moved = np.array([
            h * slopes(seen.place_m, one) for one, h in zip(known, heights, strict=True)
        ]) / seen.sd[:, None]  # fmt: skip
        aside = half[:, None, None] * moved[:, :, :-1]
        whole[:n, count:widths] = np.moveaxis(aside, 0, 1).reshape(n, -1)
        whole[:n, widths:] = moved[:, :, -1].T
        whole[len(fitted) :, widths:] = np.eye(each) * np.sqrt(scatter) / _width_sd(seen)
    spread = np.sqrt(scatter * np.diag(np.linalg.pinv(whole.T @ whole)))
    places = half[:, None] * spread[count:widths].reshape(each, seen.axes)
    return spread[count - each : count], places


def _width_sd(seen: Map) -> float:
    """Of the logarithm of a half width, any that is fitted as likely."""
    widest = widest_m(seen.spacing_m, seen.span_m)
    return float(np.log(widest / (NARROWEST * seen.spacing_m)) / np.sqrt(12))


def other_shapes_sd_m(
    seen: Map, known: list[Array], rss: float, scatter: float, rising: bool
) -> Array:
    """By how much (k, d) the places [m] of ``known`` bumps, which leave the sum of squares ``rss``,
    move with bumps of `OTHER_TAILS`, each weighted by its likelihood beside theirs.

    What a bump looks like between its stations is not known. Where few stations show it, its place
    depends on that: of 40 Gaussian ones among stations of 8 mm, 8 lie in their intervals without
    this, and 39 with it.
    """
    own = np.array([one[:-1] for one in known])
    weight, square = 1.0, np.zeros_like(own)
    for tail in OTHER_TAILS:
        other = refined(seen, known, rising, tail)
        *_, left = weighted(seen, other, tail)
        odds = (rss - float(left @ left)) / (2 * max(scatter, 1.0))
        likelihood = float(np.exp(min(odds, MAX_LOG_ODDS)))
        weight += likelihood
        square += likelihood * (np.array([one[:-1] for one in other]) - own) ** 2
    return np.asarray(np.sqrt(square / weight))
