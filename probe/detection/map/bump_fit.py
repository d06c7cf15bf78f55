"""Places and widths of all bumps of a map together, by least squares, and how wide they may be."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.optimize import least_squares

from drivers.core.arrays import Array
from probe.detection.map.row_shapes import TAIL
from probe.detection.map.seen_map import Map, bump_at, slopes, weighted

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
    seen: Map, known: list[Array], rising: bool, tail: float = TAIL, steps: int | None = None
) -> list[Array]:
    """Places and half widths [m] of bumps that are ``known`` roughly, in as many ``steps`` as it
    takes or at most; ``rising`` ones may lie at a row's ends."""
    n, pitch = len(seen.value), seen.spacing_m
    _, a, _, unexplained = weighted(seen, [])
    q, _ = np.linalg.qr(a)

    def beside_base(columns: Array) -> Array:
        """What the base cannot explain of columns (n, k), weighted, above its prior's rows."""
        padded = np.zeros((len(a), columns.shape[1]))
        padded[:n] = columns / seen.sd[:, None]
        return np.asarray(padded - q @ (q.T @ padded))

    def bumps_of(p: Sequence[float]) -> list[Array]:
        """Out of places and logarithms of widths in station distances."""
        each = np.reshape(p, (len(known), -1))
        return [np.append(bump[:-1], pitch * np.exp(bump[-1])) for bump in each]

    @lru_cache(maxsize=1)  # the slopes are asked for where the residual just was
    def bumps(p: tuple[float, ...]) -> tuple[Array, Array, Array]:
        """The bumps beside the base, an orthonormal basis of them, and what both leave."""
        own = beside_base(
            np.column_stack([bump_at(seen.place_m, bump, tail) for bump in bumps_of(p)])
        )
        basis, _ = np.linalg.qr(own)
        return own, basis, unexplained - basis @ (basis.T @ unexplained)

    def residual(p: Array) -> Array:
        return bumps(tuple(p.tolist()))[2][:n]

    def jacobian(p: Array) -> Array:
        """Of variable projection (Golub and Pereyra 1973)."""
        own, basis, rest = bumps(tuple(p.tolist()))
        inverse = np.linalg.pinv(own)
        each = len(p) // len(known)
        height = np.repeat(inverse @ unexplained, each)
        moved = beside_base(
            np.column_stack([slopes(seen.place_m, bump, tail) for bump in bumps_of(p.tolist())])
        )
        across = moved - basis @ (basis.T @ moved)
        derivative = across * height + np.repeat(inverse.T, each, axis=1) * (rest @ moved)
        return -derivative[:n]

    start = np.concatenate([np.append(bump[:-1], np.log(bump[-1] / pitch)) for bump in known])
    rim_m = rim_of(seen, rising) / 2
    low, high = seen.place_m.min(axis=0) + rim_m, seen.place_m.max(axis=0) - rim_m
    widest = np.log(widest_m(pitch, seen.span_m) / pitch)
    low = np.tile(np.append(low, np.log(NARROWEST)), len(known))
    high = np.tile(np.append(high, widest), len(known))
    scale = np.append(np.full(seen.axes, pitch), 0.3)
    solution = least_squares(residual, np.clip(start, low + 1e-9, high - 1e-9), jacobian,
                          bounds=(low, high), x_scale=np.tile(scale, len(known)),
                          xtol=SETTLED, ftol=SETTLED**2, max_nfev=steps)  # fmt: skip
    return bumps_of(solution.x.tolist())


def rim_of(seen: Map, rising: bool) -> float:
    """How far from a row's ends bumps lie that do not rise: what is there may be the block's edge.
    Of an area's presses the outermost lie anywhere within it."""
    return 0.0 if rising or not seen.is_row else seen.spacing_m
