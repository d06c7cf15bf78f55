"""What may lie in a block, as a polynomial sees it.

Lengths are over the finger's half width, moduli and pressures over the tissue's modulus, so that
one table serves every size and softness; the block's height and half its width are parameters. Each
kind says which parameters it has, from where to where, which smooth coordinates of them the
polynomials are of, and about how large a bump and a pulse are: the polynomials are of the ratio to
that.

The extent of a bump follows from the depth d of its centre: the stress that a line force makes at
a distance s falls as (d^2 / (d^2 + s^2))^2 (Johnson 1985, Contact Mechanics, eq. 2.23). How far a
vessel gives way under a pressure p follows from a thin ring in a medium, u / r = p / (2 G + E w /
r).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array, Bools

TWO_SHEAR = 2 / 2.98
"""2 G over E of nearly incompressible tissue, nu = 0.49."""
COVER, COVER_OF_VESSEL = 0.4, 0.6
"""Tissue over a body, at least: over less than 2 mm of it, pressed by 2.5 mm of a finger of 5 mm
radius, polynomials of this degree miss up to 5 % of the force; over a vessel, which bulges, 17 %
between 2 and 3 mm."""
MAX_INFLATION = 0.2
"""Widening, as a thin ring's in a medium, up to which pressures are small beside those that burst a
wall. The paper's healthy artery is at 0.19; at 0.2 to 0.25 polynomials miss a third of a pulse."""
FINGER = 0.4
"""What a finger's own width adds to a bump's, over its half width."""
BLOCK = ("log_height", "log_half_width")
"""The block's own parameters, the last of every kind, and their ranges: 9 to 30 mm high and 36 to
120 mm wide under a finger of 5 mm radius."""
BLOCK_LOW, BLOCK_HIGH = (np.log(1.8), np.log(3.6)), (np.log(6.0), np.log(12.0))
FARTHEST = 0.75
"""How far a body is from the block's middle at most, over half its width."""
OF_ROW = 2
"""Coordinates that are the same in a whole row: the last ones, of the block's width and of the
depth."""


@dataclass(frozen=True)
class Kind:
    """``parameters`` and the range in which a table is trained, in units of finger and tissue; the
    last two are the block's (`BLOCK`).

    ``coordinates`` and ``size`` are functions of where the finger is over the block's middle (n,)
    and the parameters (n, p): coordinates (n, c - 1), of which the first alone is of the place, and
    sizes (n, 2) of bump and pulse. The last coordinate is the logarithm of how deep the finger is.
    Mirrored, a block presses alike: the first ``mirrored`` coordinates change sign, and nothing
    else.
    ``degree`` and ``weights`` (c,) are those of the polynomials.
    ``inflation`` (n,) is about how far a lumen is widened by its greatest pressure.
    """

    name: str
    parameters: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    coordinates: Callable[[Array, Array], Array]
    size: Callable[[Array, Array], Array]
    radius: Callable[[Array], Array]
    inflation: Callable[[Array], Array]
    degree: int
    weights: tuple[float, ...]
    beats: bool = False
    mirrored: int = 2

    def at(self, x: Array, sunk: Array, theta: Array) -> Array:
        """All coordinates (n, c)."""
        return np.hstack([self.coordinates(x, theta), np.log(sunk)[:, None]])

    def column(self, theta: Array, name: str) -> Array:
        """One parameter (n,) of ``theta`` (n, p)."""
        return theta[:, self.parameters.index(name)]

    def fits(self, theta: Array) -> Bools:
        """Whether the body lies within its block and a table may know it (n,)."""
        depth, radius = self.column(theta, "depth"), self.radius(theta)
        height, half_width = np.exp(theta[:, -2:]).T
        trained = ((theta >= self.low) & (theta <= self.high)).all(axis=1)
        cover = COVER_OF_VESSEL if self.beats else COVER
        room = (depth - radius >= cover) & (height - depth - radius >= COVER / 2)
        inside = np.abs(theta[:, 0]) <= FARTHEST * half_width
        return np.asarray(trained & room & inside & (self.inflation(theta) <= MAX_INFLATION))

    def central(self, theta: Array) -> Array:
        """Sizes (n, 2) of bump and pulse right over the middle."""
        return self.size(theta[:, 0], theta)


def aside(x: Array, theta: Array) -> tuple[Array, Array]:
    """How far the finger is aside, -1 to 1, and how that lets the bump fall (n,)."""
    away = x - theta[:, 0]
    width = 0.8 * theta[:, 1] + FINGER
    return away / np.hypot(away, width), (width**2 / (away**2 + width**2)) ** 2


def _middle(theta: Array) -> Array:
    """How far the body is from the block's middle, over half its width."""
    return np.asarray(theta[:, 0] * np.exp(-theta[:, -1]))


def _tissue(theta: Array, radius: Array) -> tuple[Array, Array]:
    """Logarithms of the tissue over and below a body (n,); one that sticks out has none."""
    depth, height = theta[:, 1], np.exp(theta[:, -2])
    over, below = depth - radius, height - depth - radius
    return np.log(np.maximum(over, 0.0) + 0.3), np.log(np.maximum(below, 0.0) + 0.3)


def _lump_coordinates(x: Array, theta: Array) -> Array:
    _, log_diameter, log_ratio, _, log_half_width = theta.T[1:]
    over, below = _tissue(theta, _lump_radius(theta))
    across, _ = aside(x, theta)
    return np.stack([
        across, _middle(theta), over, log_diameter, log_ratio, below, log_half_width,
    ], axis=1)  # fmt: skip


def _lump_size(x: Array, theta: Array) -> Array:
    _, falls = aside(x, theta)
    ratio = np.exp(theta[:, 3])
    bump = (np.exp(theta[:, 2]) / theta[:, 1]) ** 1.6 * falls * (ratio - 1) / (ratio + 1)
    return np.stack([bump, np.zeros_like(bump)], axis=1)


def _lump_radius(theta: Array) -> Array:
    return np.asarray(np.exp(theta[:, 2]) / 2)


def ring_stiffness(theta: Array) -> Array:
    """E w / r (n,) of a vessel's wall and of the plaque in it, over the tissue's modulus."""
    _, _, _, log_wall, log_ratio, _, _, narrowing, log_plaque, *_ = theta.T
    return np.asarray(np.exp(log_ratio) * (2 * np.exp(log_wall) + narrowing * np.exp(log_plaque)))


def _vessel_coordinates(x: Array, theta: Array) -> Array:
    _, log_inner, log_wall, _, log_pressure, swing, narrowing, log_plaque = theta.T[1:-2]
    pressure = np.exp(log_pressure)
    gives = TWO_SHEAR + ring_stiffness(theta)
    over, below = _tissue(theta, _vessel_radius(theta))
    across, _ = aside(x, theta)
    return np.stack([
        across, _middle(theta), over, log_inner, log_wall, np.log(gives), pressure / gives,
        swing * pressure / gives, narrowing, log_plaque * narrowing, below, theta[:, -1],
    ], axis=1)  # fmt: skip


def _vessel_size(x: Array, theta: Array) -> Array:
    _, falls = aside(x, theta)
    bump = (np.exp(theta[:, 2]) / theta[:, 1]) ** 1.6 * falls
    gives = TWO_SHEAR + ring_stiffness(theta)
    return np.stack([bump, bump * np.exp(theta[:, 5]) * theta[:, 6] / gives], axis=1)


def _vessel_radius(theta: Array) -> Array:
    return np.asarray(np.exp(theta[:, 2]) * (0.5 + np.exp(theta[:, 3])))


def _widened(theta: Array) -> Array:
    systole = np.exp(theta[:, 5]) * (1 + theta[:, 6])
    return np.asarray(systole / (TWO_SHEAR + ring_stiffness(theta)))


def _none(theta: Array) -> Array:
    return np.zeros(len(theta))


LUMP = Kind(
    "lump",
    ("x", "depth", "log_diameter", "log_ratio", *BLOCK),
    (-9.0, 0.7, np.log(0.5), np.log(2.0), *BLOCK_LOW),
    (9.0, 2.9, np.log(2.2), np.log(60.0), *BLOCK_HIGH),
    _lump_coordinates, _lump_size, _lump_radius, _none, degree=5,
    weights=(0.7, 1, 1, 1, 1, 1.5, 2, 1),
)  # fmt: skip
VESSEL = Kind(
    "vessel",
    ("x", "depth", "log_inner", "log_wall", "log_ratio", "log_pressure", "swing", "narrowing",
     "log_plaque", *BLOCK),
    (-9.0, 0.7, np.log(0.36), np.log(0.09), np.log(4.0), np.log(0.05), 0.2, 0.0, np.log(1.5),
     *BLOCK_LOW),
    (9.0, 2.9, np.log(1.3), np.log(0.20), np.log(100.0), np.log(1.4), 1.05, 0.7, np.log(12.0),
     *BLOCK_HIGH),
    _vessel_coordinates, _vessel_size, _vessel_radius, _widened, degree=5,
    weights=(0.8, 1, 1.2, 1.2, 2.4, 1.2, 1.2, 1.2, 2.4, 2.4, 1.6, 2.4, 1.2),
    beats=True,
)  # fmt: skip
KINDS = (LUMP, VESSEL)


def _bare_coordinates(x: Array, theta: Array) -> Array:
    """How near the block's two sides are, over its height; its height; and the depth."""
    height, half_width = np.exp(theta).T
    aside = np.abs(x)
    near, far = (np.exp(-(half_width + side * aside) / height) for side in (-1, 1))
    return np.stack([near, far, theta[:, 0]], axis=1)


def _ones(_x: Array, theta: Array) -> Array:
    return np.ones((len(theta), 2))


BARE = Kind(
    "bare", BLOCK, BLOCK_LOW, BLOCK_HIGH, _bare_coordinates, _ones, _none, _none, degree=8,
    weights=(1, 1, 1, 1.5), mirrored=0,
)  # fmt: skip
"""The block with nothing in it: the logarithm of its force over its depth, in place of a bump."""
