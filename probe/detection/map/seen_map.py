"""A map of one value over places: of an area, or of a row, which is one on a line."""

from dataclasses import dataclass

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.row_shapes import CURVATURE, EDGE, TAIL, level_of
from probe.detection.repeats import pitch_m


@dataclass(frozen=True)
class Map:
    """Presses at ``place_m`` (n, d), along a line or over an area, and values (n,) with their
    standard deviations (n,). ``base`` (n, k) are the columns under the bumps, ``prior_weight`` (k,)
    the inverse standard deviations of their priors; ``spacing_m`` is the usual distance from one
    place to the next."""

    place_m: Array
    value: Array
    sd: Array
    base: Array
    prior_weight: Array
    spacing_m: float

    @property
    def axes(self) -> int:
        return int(self.place_m.shape[1])

    @property
    def is_row(self) -> bool:
        return self.axes == 1

    @property
    def unknowns(self) -> int:
        """Of a bump: its place, width and height."""
        return self.axes + 2

    @property
    def span_m(self) -> float:
        """Its longer side."""
        return float(np.ptp(self.place_m, axis=0).max())


def row_of(x_m: Array, value: Array, sd: Array, base: Array) -> Map:
    """A row of stations at ``x_m`` (n,), ascending; ``base`` (n, k) is `surroundings`, `floor` or
    `with_edges`, or begins with one of them."""
    held = np.array([0.0, 0.0, 1 / CURVATURE, 1 / EDGE, 1 / EDGE])[: base.shape[1]]
    weight = np.append(held, np.zeros(base.shape[1] - len(held))) / level_of(value)
    return Map(x_m[:, None], value, sd, base, weight, pitch_m(x_m))


def bump_at(place_m: Array, bump: Array, tail: float = TAIL) -> Array:
    """What a bump (its place, then its half width: (d + 1,)) of a height of 1 makes at presses
    (n, d): (n,)."""
    return fallen(((place_m - bump[:-1]) ** 2).sum(axis=1) / bump[-1] ** 2, tail)


def fallen(square: Array, tail: float = TAIL) -> Array:
    """A bump by the square of the distance over the half width."""
    return np.asarray((1 + square / tail) ** -tail)


def slopes(place_m: Array, bump: Array, tail: float = TAIL) -> Array:
    """Derivatives (n, d + 1) of `bump_at` by the bump's place and the logarithm of its width."""
    u = (place_m - bump[:-1]) / bump[-1]
    square = (u**2).sum(axis=1, keepdims=True)
    slope = 2 * (1 + square / tail) ** -(tail + 1)
    return np.hstack([slope * u / bump[-1], slope * square])


def weighted(
    seen: Map, known: list[Array], tail: float = TAIL
) -> tuple[Array, Array, Array, Array]:
    """Columns, and weighted with what holds them: columns, values, residual."""
    columns = np.column_stack([seen.base, *(bump_at(seen.place_m, one, tail) for one in known)])
    prior = np.diag(np.append(seen.prior_weight, np.zeros(len(known))))
    a = np.vstack([columns / seen.sd[:, None], prior])
    b = np.append(seen.value / seen.sd, np.zeros(len(prior)))
    q, _ = np.linalg.qr(a)
    return columns, a, b, b - q @ (q.T @ b)


def explained(a: Array, left: Array, columns: Array) -> tuple[Array, Array]:
    """How much less of the residual ``left`` (n + p,), squared, each of ``columns`` (n, m) would
    leave beside ``a`` (n + p, k), and at which height: (m,) each; all are weighted, and ``a`` ends
    in the p rows of what holds it."""
    own = np.zeros((len(a), columns.shape[1]))
    own[: len(columns)] = columns
    q, _ = np.linalg.qr(a)
    own -= q @ (q.T @ own)
    size = np.maximum((own**2).sum(axis=0), 1e-300)
    height = left @ own / size
    return size * height**2, height
