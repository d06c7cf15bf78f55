"""Rivals of a bump in a row of stations: one odd press, waves, far edges or a step."""

from collections.abc import Callable

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.row_shapes import EDGE_M, step, weighted
from probe.detection.repeats import pitch_m

CLOSE_M, FURTHER = 3e-3, (1.5, 2.0, 3.0, 4.0)
"""Stations that show how far a block's sides reach in, and what is tried over `EDGE_M`: a section
of 30 mm shows 3 times."""
LEFT_OUT, MAX_LOG_ODDS = 1e6, 10.0
"""Scatter over its own that leaves a station out of a fit; odds beyond these change no finding."""
MIN_TURNS, PITCHES_OF_A_WAVE, TURNS_STEP = 1.5, 2.5, 0.125
"""Of a wave along a row: fewer turns are its curvature, stations show none that is shorter, and two
that differ by less than the step part by an eighth of a turn at most."""
RISE_WIDTHS = (0.5, 1.0, 2.0, 4.0)
"""Of a step from one level to another, or of a ridge, in station distances."""


def odds_of_one_press(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]], k: int,
    rss: float, scatter: float,
) -> float:  # fmt: skip
    """Odds that the press nearest to the bump ``known[k]`` differs by itself: the likelihood
    without the press and the bump over that with them, ``rss``."""
    left_out = np.abs(x_m - known[k][0]) == np.abs(x_m - known[k][0]).min()
    *_, left = weighted(
        x_m, value, np.where(left_out, LEFT_OUT * sd, sd), base, [*known[:k], *known[k + 1 :]]
    )
    return odds_instead([(float(left @ left), 0)], rss, scatter, len(x_m))


def odds_of_uneven_row(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]], k: int,
    rss: float, scatter: float,
) -> float:  # fmt: skip
    """Odds that the row waves, that its edges reach further or that it is stiffer on one side,
    instead of the bump ``known[k]``, or of all ``known``; each has three unknowns, as a bump."""
    rises = rises_anywhere(x_m, pitch_m(x_m), step)
    rivals = [c / sd[:, None] for c in (_waves(x_m), _further_edges(x_m), rises)]
    fits = []
    for others in {(*known[:k], *known[k + 1 :]), ()}:
        _, a, _, left = weighted(x_m, value, sd, base, list(others))
        fewer = 3 * (len(known) - 1 - len(others))
        fits += [(least_left(a, left, columns), fewer) for columns in rivals]
    return odds_instead(fits, rss, scatter, len(x_m))


def odds_instead(fits: list[tuple[float, int]], rss: float, scatter: float, count: int) -> float:
    """Odds of the likeliest of ``fits`` against one that leaves the sum of squares ``rss``, alike
    beforehand. Each is the sum it leaves and how many unknowns fewer it has; each unknown costs
    half the logarithm of the ``count`` of presses (Schwarz 1978)."""
    best = max(
        (rss - left) / (2 * max(scatter, 1.0)) + fewer * np.log(count) / 2 for left, fewer in fits
    )
    return float(np.exp(min(best, MAX_LOG_ODDS)))


def least_left(a: Array, left: Array, rivals: Array) -> float:
    """The least sum of squares of the residual ``left`` that one of ``rivals`` (m, n, k), beside
    the weighted columns ``a``, would leave."""
    q, _ = np.linalg.qr(a)
    whole = np.zeros((len(rivals), len(a), rivals.shape[2]))
    whole[:, : rivals.shape[1]] = rivals
    basis, _ = np.linalg.qr(whole - q @ (q.T @ whole))
    return float(left @ left - ((left @ basis) ** 2).sum(axis=-1).max(initial=0.0))


def rises_anywhere(
    x_m: Array, scale_m: float, rise: Callable[[Array, Array, Array], Array]
) -> Array:
    """Columns (m, n, 1) of ``rise``, a function of ``x_m`` (n,), middles and widths: from anywhere
    along ``x_m``, or just beyond, to anywhere on a scale of `RISE_WIDTHS`."""
    middles_m = np.arange(x_m.min() - scale_m, x_m.max() + 1.5 * scale_m, scale_m / 2)
    widths_m = scale_m * np.array(RISE_WIDTHS)[:, None, None]
    return rise(x_m, middles_m[:, None], widths_m).reshape(-1, len(x_m), 1)


def _waves(x_m: Array) -> Array:
    """Pairs of columns (m, n, 2) of waves that are no curvature and that stations show."""
    pitch, along = pitch_m(x_m), x_m - x_m[0]
    turns = np.arange(MIN_TURNS, along[-1] / pitch / PITCHES_OF_A_WAVE, TURNS_STEP)
    angles = 2 * np.pi * turns[:, None] * along / along[-1]
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _further_edges(x_m: Array) -> Array:
    """Pairs of columns (m, n, 2) of edges that reach further, as a high block's do, where stations
    are so close that they show the difference from a lump."""
    if round(pitch_m(x_m), 4) > CLOSE_M:  # to what poses are exact to, 0.1 mm
        return np.zeros((0, len(x_m), 2))
    off_m = np.abs(x_m[:, None] - x_m[[0, -1]])
    return np.exp(-off_m / (EDGE_M * np.array(FURTHER)[:, None, None]))
