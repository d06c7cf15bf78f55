"""Rivals of a bump in a map: one odd press, waves, far edges, a step, or a ridge across an area."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.row_shapes import EDGE_M, shape, step
from probe.detection.map.seen_map import Map, weighted

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
TURNS_RAD = np.pi / 24 * np.arange(24)
"""In which a line is tried, over half a turn: none is more than 3.8 degrees off, which moves it by
a quarter of the distance between presses at the rim of a map that is eight of them wide."""

Rise = Callable[[Array, Array, Array], Array]


def odds_of_one_press(seen: Map, known: list[Array], k: int, rss: float, scatter: float) -> float:
    """Odds that the press nearest to the bump ``known[k]`` differs by itself: the likelihood
    without the press and the bump over that with them, ``rss``."""
    off = ((seen.place_m - known[k][:-1]) ** 2).sum(axis=1)
    doubted = replace(seen, sd=np.where(off == off.min(), LEFT_OUT * seen.sd, seen.sd))
    *_, residual = weighted(doubted, [*known[:k], *known[k + 1 :]])
    return _odds_instead([(float(residual @ residual), 0)], rss, scatter, len(off))


def odds_of_uneven(seen: Map, known: list[Array], k: int, rss: float, scatter: float) -> float:
    """Odds that a row waves, that its edges reach further or that it is stiffer on one side, or an
    area on one side or along a line, instead of the bump ``known[k]``, or of all ``known``; each
    has as many unknowns as a bump."""
    rest = [*known[:k], *known[k + 1 :]]
    rests = []
    for kept in (rest, []) if rest else ([],):
        _, a, _, residual = weighted(seen, kept)
        rests.append((a, residual, seen.unknowns * (len(rest) - len(kept))))
    fits = [
        (_least_left(a, residual, columns / seen.sd[:, None]), fewer)
        for columns in _rivals(seen) for a, residual, fewer in rests
    ]  # fmt: skip
    return _odds_instead(fits, rss, scatter, len(seen.value))


def _rivals(seen: Map) -> Iterator[Array]:
    """Columns (m, n, k) of what else may be there, some at a time: of a large map all take a
    gigabyte."""
    if seen.is_row:
        x_m = seen.place_m[:, 0]
        yield _waves(x_m, seen.spacing_m)
        if round(seen.spacing_m, 4) <= CLOSE_M:  # to what poses are exact to, 0.1 mm
            yield _further_edges(x_m)
        yield rises_anywhere(x_m, seen.spacing_m, step)
        return
    for along_m in directions(seen).T:
        for rise in (step, shape):  # of a bone that a corner cuts short its end is as a bump
            yield rises_anywhere(along_m, seen.spacing_m, rise)


def _odds_instead(fits: list[tuple[float, int]], rss: float, scatter: float, count: int) -> float:
    """Odds of the likeliest of ``fits`` against one that leaves the sum of squares ``rss``, alike
    beforehand. Each is the sum it leaves and how many unknowns fewer it has; each unknown costs
    half the logarithm of the ``count`` of presses (Schwarz 1978)."""
    best = max(
        (rss - rival_rss) / (2 * max(scatter, 1.0)) + fewer * np.log(count) / 2
        for rival_rss, fewer in fits
    )
    return float(np.exp(min(best, MAX_LOG_ODDS)))


def _least_left(a: Array, residual: Array, rivals: Array) -> float:
    """The least sum of squares of the residual ``left`` that one of ``rivals`` (m, n, k), beside
    the weighted columns ``a``, would leave."""
    q, _ = np.linalg.qr(a)
    padded = np.zeros((len(rivals), len(a), rivals.shape[2]))
    padded[:, : rivals.shape[1]] = rivals
    basis, _ = np.linalg.qr(padded - q @ (q.T @ padded))
    return float(residual @ residual - ((residual @ basis) ** 2).sum(axis=-1).max(initial=0.0))


def rises_anywhere(x_m: Array, scale_m: float, rise: Rise) -> Array:
    """Columns (m, n, 1) of ``rise``, a function of ``x_m`` (n,), middles and widths: from anywhere
    along ``x_m``, or just beyond, to anywhere on a scale of `RISE_WIDTHS`."""
    middles_m = np.arange(x_m.min() - scale_m, x_m.max() + 1.5 * scale_m, scale_m / 2)
    widths_m = scale_m * np.array(RISE_WIDTHS)[:, None, None]
    return rise(x_m, middles_m[:, None], widths_m).reshape(-1, len(x_m), 1)


def directions(seen: Map) -> Array:
    """How far an area's presses lie along each of `TURNS_RAD` (n, directions) [m]."""
    return np.asarray(seen.place_m @ np.array([np.cos(TURNS_RAD), np.sin(TURNS_RAD)]))


def _waves(x_m: Array, pitch_m: float) -> Array:
    """Pairs of columns (m, n, 2) of waves that are no curvature and that stations show."""
    along = x_m - x_m[0]
    turns = np.arange(MIN_TURNS, along[-1] / pitch_m / PITCHES_OF_A_WAVE, TURNS_STEP)
    angles = 2 * np.pi * turns[:, None] * along / along[-1]
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _further_edges(x_m: Array) -> Array:
    """Pairs of columns (m, n, 2) of edges that reach further, as a high block's do, where stations
    are so close that they show the difference from a lump."""
    off_m = np.abs(x_m[:, None] - x_m[[0, -1]])
    return np.exp(-off_m / (EDGE_M * np.array(FURTHER)[:, None, None]))
