"""Spots in a map of presses at any places (x, y), which form no rows."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import Delaunay, QhullError, cKDTree
from scipy.special import stdtrit

from drivers.core.arrays import Array, Bools
from probe.core.places import SAME_PLACE_M
from probe.detection.map.bump_fit import NARROWEST, SETTLED, tried_m, widest_m
from probe.detection.map.bumps import MIN_DISTANCE, TRUSTED, chance
from probe.detection.map.row_shapes import CURVATURE, explained, level_of

MIN_PRESSES = 15
"""Places that can show a spot (four unknowns) apart from a curved background (six)."""
FINER = 2
"""Centres that are tried along x or y for each distance between presses."""
SPOT_UNKNOWNS = 4
MAX_SPOTS = 4
AT_ONCE = 1 << 19
"""Numbers in a table of what spots make, 4 MB: at once all that 1,000 presses at random places may
show took 3.4 GB, and three times as long."""
WITHIN = 0.999
"""A point on the edge, drawn in by the rest, is inside for whatever rounding does."""
NARROW = 2.0
"""Distances between presses that a map must be wide in both directions, or it is a line."""


@dataclass(frozen=True)
class Spot:
    """``height`` above the background at ``place_m`` (2,), with the half width of its 95 % interval
    ``reach_m`` (2,); ``p_value``: chance of one as clear anywhere in a map that has none."""

    place_m: Array
    reach_m: Array
    height: float
    height_sd: float
    half_width_m: float
    background: float
    p_value: float


@dataclass(frozen=True)
class Map:
    """Presses at ``place_m`` (n, 2), and values (n,) with their standard deviations (n,).
    ``base`` (n, k) are the columns under the spots, ``prior_weight`` (k,) the inverse standard
    deviations of their priors."""

    place_m: Array
    value: Array
    sd: Array
    base: Array
    prior_weight: Array
    spacing_m: float

    @property
    def span_m(self) -> float:
        """Its longer side."""
        return float(np.ptp(self.place_m, axis=0).max())


def spacing_m(place_m: Array) -> float:
    """The usual distance from one press (n, 2) to the next, repeats aside; 0 where all lie on a
    line."""
    repeats = cKDTree(place_m).query_pairs(SAME_PLACE_M, output_type="ndarray")
    places = np.delete(place_m, repeats[:, 1], axis=0)
    if len(places) < MIN_PRESSES:
        return 0.0
    usual = float(np.median(np.asarray(cKDTree(places).query(places, k=2)[0])[:, 1]))
    across = np.sqrt(12 * np.linalg.eigvalsh(np.atleast_2d(np.cov(places.T))).min())
    return usual if across >= NARROW * usual else 0.0


def map_of(place_m: Array, value: Array, sd: Array, *, curved: bool = True) -> Map:
    """A map over a level that is tilted and ``curved``, or else the same everywhere."""
    widest_m = float((place_m.max(axis=0) - place_m.min(axis=0)).max())
    u = (place_m - place_m.mean(axis=0)) / widest_m
    one, x, y = np.ones(len(u)), u[:, 0], u[:, 1]
    columns = np.column_stack([one, x, y, x * x, x * y, y * y] if curved else [one])
    weight = np.array([0.0, 0.0, 0.0, *[1 / CURVATURE] * 3])[: columns.shape[1]]
    return Map(place_m, value, sd, columns, weight / level_of(value), spacing_m(place_m))


def find_spots(seen: Map, false_alarm: float, *, rising: bool = False) -> list[Spot]:
    """Up to `MAX_SPOTS` spots, the clearest first; where ``rising``, dips are none."""
    if seen.spacing_m <= 0:
        return []
    centres = _centres(seen)
    known: list[Array] = []
    chances: list[float] = []
    while len(known) < MAX_SPOTS:
        far = [np.hypot(*(centres - k[:2]).T) >= MIN_DISTANCE * seen.spacing_m for k in known]
        free = centres[np.logical_and.reduce(far)] if known else centres
        if not len(free):
            break
        best, before, after = _clearest(seen, free, known, rising=rising)
        dof = len(seen.value) - seen.base.shape[1] - SPOT_UNKNOWNS * len(known)
        independent = 2 * max(len(free) / FINER**2, 1.0)
        p_value = chance(before, after, SPOT_UNKNOWNS, dof, independent)
        if p_value > false_alarm or dof <= 2 * SPOT_UNKNOWNS:
            break
        known = _refined(seen, [*known, best])
        chances.append(p_value)
    return _spots(seen, known, chances)


def spot_at(seen: Map, other: Spot) -> Spot:
    """Another map's spot in this one, its place and width kept."""
    (found,) = _spots(seen, [np.append(other.place_m, other.half_width_m)], [1.0])
    return found


def shape(place_m: Array, spot: Array) -> Array:
    """What a ball makes, as a row's bump is: (n,) for a spot (x, y, half width)."""
    return _of_square(((place_m - spot[:2]) ** 2).sum(axis=1) / spot[2] ** 2)


def _of_square(square: Array) -> Array:
    """By the square of the distance over the half width."""
    fallen = 1 + square / 1.5
    return np.asarray(1 / (fallen * np.sqrt(fallen)))


def among(point_m: Array, place_m: Array) -> Bools:
    """Which points (k, 2) lie among presses (n, 2), edges included: (k,), none if those lie on a
    line."""
    try:
        hull = Delaunay(place_m)
    except QhullError:
        return np.zeros(len(point_m), dtype=bool)
    middle_m = place_m.mean(axis=0)
    return np.asarray(hull.find_simplex(middle_m + WITHIN * (point_m - middle_m)) >= 0)


def _clearest(
    seen: Map, centres: Array, known: list[Array], *, rising: bool
) -> tuple[Array, float, float]:
    """The spot (3,) at one of ``centres`` (c, 2) that explains most beside the ``known`` ones, and
    the sum of squares without it and with it."""
    width = tried_m(seen.spacing_m, seen.span_m)
    _, a, _, left = weighted(seen, known)
    n, before = len(seen.value), float(left @ left)
    best, most = np.append(centres[0], width[0]), 0.0
    parts = min(-(-len(centres) * len(width) * n // AT_ONCE), len(centres))
    for some in np.array_split(centres, parts):
        square = ((seen.place_m[:, None] - some) ** 2).sum(axis=2)[:, :, None] / width**2
        shapes = _of_square(square).reshape(n, -1)
        drop, height = explained(a, left, shapes / seen.sd[:, None])
        if rising:
            drop[height < 0] = 0.0
        k = int(np.argmax(drop))
        if drop[k] > most:
            best, most = np.append(some[k // len(width)], width[k % len(width)]), float(drop[k])
    return best, before, before - most


def _centres(seen: Map) -> Array:
    """Places to try: a grid within the presses' hull."""
    low, high = seen.place_m.min(axis=0), seen.place_m.max(axis=0)
    axes = [np.arange(a, b, seen.spacing_m / FINER) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return grid[among(grid, seen.place_m)]


def weighted(seen: Map, known: list[Array]) -> tuple[Array, Array, Array, Array]:
    """Columns, and weighted with what holds them: columns, values, residual."""
    columns = np.column_stack([seen.base, *(shape(seen.place_m, one) for one in known)])
    prior = np.diag(np.append(seen.prior_weight, np.zeros(len(known))))
    a = np.vstack([columns / seen.sd[:, None], prior])
    b = np.append(seen.value / seen.sd, np.zeros(len(prior)))
    q, _ = np.linalg.qr(a)
    return columns, a, b, b - q @ (q.T @ b)


def _refined(seen: Map, known: list[Array]) -> list[Array]:
    """Places and widths of all spots together, by least squares."""
    unit = seen.spacing_m
    widest = widest_m(unit, seen.span_m) / unit

    def spots(p: Array) -> list[Array]:
        return [np.append(one[:2], unit * np.exp(one[2])) for one in p.reshape(-1, 3)]

    def residual(p: Array) -> Array:
        return weighted(seen, spots(p))[3][: len(seen.value)]

    start = np.concatenate([np.append(k[:2], np.log(k[2] / unit)) for k in known])
    low = np.tile(np.append(seen.place_m.min(axis=0), np.log(NARROWEST)), len(known))
    high = np.tile(np.append(seen.place_m.max(axis=0), np.log(widest)), len(known))
    found = least_squares(residual, np.clip(start, low + 1e-9, high - 1e-9), bounds=(low, high),
                          x_scale=np.tile([unit, unit, 0.3], len(known)),
                          xtol=SETTLED, ftol=SETTLED**2)  # fmt: skip
    return spots(found.x)


def _spots(seen: Map, known: list[Array], chances: list[float]) -> list[Spot]:
    """The spots with their doubts, from the fit's Jacobian."""
    if not known:
        return []
    columns, a, b, left = weighted(seen, known)
    k = seen.base.shape[1]
    coefficients = np.linalg.lstsq(a, b, rcond=None)[0]
    dof = max(len(seen.value) - k - SPOT_UNKNOWNS * len(known), 1)
    scatter = float(np.sqrt((left @ left + TRUSTED) / (dof + TRUSTED)))
    slopes = []
    for spot, height in zip(known, coefficients[k:], strict=True):
        for i in range(3):
            step = np.zeros(3)
            step[i] = 1e-3 * spot[2]
            rise = shape(seen.place_m, spot + step) - shape(seen.place_m, spot - step)
            slopes.append(height * rise / 2e-3 / spot[2])
    jacobian = np.column_stack([columns, *slopes]) / seen.sd[:, None]
    prior_rows = np.zeros((k, jacobian.shape[1]))
    prior_rows[:, :k] = np.diag(seen.prior_weight)
    sd = scatter * np.sqrt(
        np.diag(np.linalg.pinv(jacobian.T @ jacobian + prior_rows.T @ prior_rows))
    )
    wide = float(stdtrit(dof + TRUSTED, 0.975))
    under = columns[:, :k] @ coefficients[:k]
    found = []
    for i, (spot, p_value) in enumerate(zip(known, chances, strict=True)):
        at = k + len(known) + 3 * i
        nearest = int(np.argmin(((seen.place_m - spot[:2]) ** 2).sum(axis=1)))
        found.append(Spot(spot[:2], wide * sd[at : at + 2], float(coefficients[k + i]),
                          float(sd[k + i]), float(spot[2]), float(under[nearest]),
                          p_value))  # fmt: skip
    return found
