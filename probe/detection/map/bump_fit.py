"""Places and widths of all bumps of a row together, by least squares, and how wide they may be."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.optimize import least_squares

from drivers.core.arrays import Array
from probe.detection.map.row_shapes import TAIL, shape, slopes, weighted
from probe.detection.repeats import pitch_m

SETTLED = 1e-4
"""Of places and widths in station distances: a hundredth of what is ever known of them."""
NARROWEST, WIDEST = 0.45, 4.0
"""Half widths of a fit, in station distances; any between is as likely, in the logarithm."""
WIDEST_M, WIDEST_SHARE = 16e-3, 1 / 3.5
"""Closer stations make no tissue narrower: a bump may be as wide as in 15 stations of 4 mm, and as
wide a share of its row. With 4 station distances alone, one artery below stations of 1 mm was three
at 99 %."""
FIRST, WIDER = 0.7, 2**0.5
"""Half widths that are tried: the first in station distances, and what each is over the last."""


def widest_m(station_m: float, span_m: float) -> float:
    """The widest half width in a row or map of ``span_m``, with a station every ``station_m``."""
    return max(WIDEST * station_m, min(WIDEST_M, WIDEST_SHARE * span_m))


def tried_m(station_m: float, span_m: float) -> Array:
    """Half widths (k,) that a bump is looked for with."""
    most = widest_m(station_m, span_m) / station_m
    count = int(np.log(most / FIRST) / np.log(WIDER) + 1e-9)
    return np.asarray(station_m * FIRST * WIDER ** np.arange(count))


def refined(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]],
    rising: bool, tail: float = TAIL, steps: int | None = None,
) -> list[tuple[float, float]]:  # fmt: skip
    """Places and half widths [m] of bumps that are ``known`` roughly, in as many ``steps`` as it
    takes or at most; ``rising`` ones may lie at the row's ends."""
    n, pitch = len(x_m), pitch_m(x_m)
    _, a, _, left = weighted(x_m, value, sd, base, [])
    q, _ = np.linalg.qr(a)

    def beside(columns: Array) -> Array:
        """What the base cannot explain of columns (n, k), weighted, above its prior's rows."""
        whole = np.zeros((len(a), columns.shape[1]))
        whole[:n] = columns / sd[:, None]
        return np.asarray(whole - q @ (q.T @ whole))

    @lru_cache(maxsize=1)  # the slopes are asked for where the residual just was
    def bumps(p: tuple[float, ...]) -> tuple[Array, Array, Array]:
        """The bumps beside the base, an orthonormal basis of them, and what both leave."""
        shapes = np.column_stack([shape(x_m, c, w, tail) for c, w in _bumps(p, pitch)])
        own = beside(shapes)
        basis, _ = np.linalg.qr(own)
        return own, basis, left - basis @ (basis.T @ left)

    def residual(p: Array) -> Array:
        return bumps(tuple(p.tolist()))[2][:n]

    def jacobian(p: Array) -> Array:
        """Of variable projection (Golub and Pereyra 1973)."""
        own, basis, rest = bumps(tuple(p.tolist()))
        inverse = np.linalg.pinv(own)
        height = np.repeat(inverse @ left, 2)
        moved = beside(
            np.column_stack([slopes(x_m, c, w, tail) for c, w in _bumps(p.tolist(), pitch)])
        )
        across = moved - basis @ (basis.T @ moved)
        found = across * height + np.repeat(inverse.T, 2, axis=1) * (rest @ moved)
        return -found[:n]

    start = np.array([v for c, w in known for v in (c, np.log(w / pitch))])
    end = 0.0 if rising else pitch / 2
    low = np.tile([x_m[0] + end, np.log(NARROWEST)], len(known))
    high = np.tile([x_m[-1] - end, np.log(widest_m(pitch, float(np.ptp(x_m))) / pitch)], len(known))
    found = least_squares(residual, np.clip(start, low + 1e-9, high - 1e-9), jacobian,
                          bounds=(low, high), x_scale=np.tile([pitch, 0.3], len(known)),
                          xtol=SETTLED, ftol=SETTLED**2, max_nfev=steps)  # fmt: skip
    return _bumps(found.x.tolist(), pitch)


def _bumps(p: Sequence[float], pitch: float) -> list[tuple[float, float]]:
    """Places and widths out of places and logarithms of widths in pitches."""
    return list(zip(p[::2], (pitch * np.exp(p[1::2])).tolist(), strict=True))
