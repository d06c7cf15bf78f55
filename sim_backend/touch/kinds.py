"""What may lie in a block, as a polynomial sees it.

Lengths are over the finger's half width, moduli and pressures over the tissue's modulus, so that
one table serves every size and softness. Each kind says which parameters it has, from where to
where, which smooth coordinates of them the polynomials are of, and about how large a bump and a
pulse are: the polynomials are of the ratio to that.

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
COVER = 0.4
"""Tissue over a body, at least: over less than 2 mm of it, pressed by 2.5 mm of a finger of 5 mm
radius, polynomials of this degree miss up to 5 % of the force."""
MAX_INFLATION = 0.25
"""Widening, as a thin ring's in a medium, up to which pressures are small beside those that burst a
wall. The paper's healthy artery is at 0.19; with 0.3 a table misses 10 % of a pulse and not 8 %."""
FINGER = 0.4
"""What a finger's own width adds to a bump's, over its half width."""


@dataclass(frozen=True)
class Kind:
    """``parameters`` and the range in which a table is trained, in units of finger and tissue.

    ``coordinates`` and ``size`` are functions of where the finger is over the block's middle (n,),
    how deep it is pressed (n,), and the parameters (n, p): coordinates (n, c), of which the first
    alone is of the place and the last alone of the depth, and sizes (n, 2) of bump and pulse.
    ``inflation``
    (n,) is about how far a lumen is widened by its greatest pressure.
    """

    name: str
    parameters: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    coordinates: Callable[[Array, Array, Array], Array]
    size: Callable[[Array, Array], Array]
    radius: Callable[[Array], Array]
    inflation: Callable[[Array], Array]
    degree: int
    beats: bool = False

    def column(self, theta: Array, name: str) -> Array:
        """One parameter (n,) of ``theta`` (n, p)."""
        return theta[:, self.parameters.index(name)]

    def fits(self, theta: Array, height: float) -> Bools:
        """Whether the body lies within a block of ``height`` and a table may know it (n,)."""
        depth, radius = self.column(theta, "depth"), self.radius(theta)
        room = (depth - radius >= COVER) & (height - depth - radius >= COVER / 2)
        return room & (self.inflation(theta) <= MAX_INFLATION)

    def central(self, theta: Array) -> Array:
        """Sizes (n, 2) of bump and pulse right over the middle."""
        return self.size(theta[:, 0], theta)


def _aside(x: Array, theta: Array) -> tuple[Array, Array]:
    """How far the finger is aside, -1 to 1, and how that lets the bump fall (n,)."""
    aside = x - theta[:, 0]
    width = 0.8 * theta[:, 1] + FINGER
    return aside / np.hypot(aside, width), (width**2 / (aside**2 + width**2)) ** 2


def _lump_coordinates(x: Array, sunk: Array, theta: Array) -> Array:
    middle, depth, log_diameter, log_ratio = theta.T
    cover = depth - _lump_radius(theta)
    aside, _ = _aside(x, theta)
    return np.stack([aside, middle, np.log(cover + 0.3), log_diameter, log_ratio, sunk], axis=1)


def _lump_size(x: Array, theta: Array) -> Array:
    _, falls = _aside(x, theta)
    bump = (np.exp(theta[:, 2]) / theta[:, 1]) ** 1.6 * falls
    return np.stack([bump, np.zeros_like(bump)], axis=1)


def _lump_radius(theta: Array) -> Array:
    return np.asarray(np.exp(theta[:, 2]) / 2)


def ring_stiffness(theta: Array) -> Array:
    """E w / r (n,) of a vessel's wall and of the plaque in it, over the tissue's modulus."""
    _, _, _, log_wall, log_ratio, _, _, narrowing, log_plaque = theta.T
    return np.asarray(np.exp(log_ratio) * (2 * np.exp(log_wall) + narrowing * np.exp(log_plaque)))


def _vessel_coordinates(x: Array, sunk: Array, theta: Array) -> Array:
    middle, depth, log_inner, log_wall, _, pressure, swing, narrowing, log_plaque = theta.T
    gives = TWO_SHEAR + ring_stiffness(theta)
    cover = depth - _vessel_radius(theta)
    aside, _ = _aside(x, theta)
    return np.stack([
        aside, middle, np.log(cover + 0.3), log_inner, log_wall, np.log(gives), pressure / gives,
        swing / gives, narrowing, log_plaque * narrowing, sunk,
    ], axis=1)  # fmt: skip


def _vessel_size(x: Array, theta: Array) -> Array:
    _, falls = _aside(x, theta)
    bump = (np.exp(theta[:, 2]) / theta[:, 1]) ** 1.6 * falls
    gives = TWO_SHEAR + ring_stiffness(theta)
    return np.stack([bump, bump * theta[:, 6] / gives], axis=1)


def _vessel_radius(theta: Array) -> Array:
    return np.asarray(np.exp(theta[:, 2]) * (0.5 + np.exp(theta[:, 3])))


def _widened(theta: Array) -> Array:
    return np.asarray((theta[:, 5] + theta[:, 6]) / (TWO_SHEAR + ring_stiffness(theta)))


def _none(theta: Array) -> Array:
    return np.zeros(len(theta))


LUMP = Kind(
    "lump",
    ("x", "depth", "log_diameter", "log_ratio"),
    (-3.6, 0.7, np.log(0.5), np.log(2.0)),
    (3.6, 2.9, np.log(2.2), np.log(60.0)),
    _lump_coordinates, _lump_size, _lump_radius, _none, degree=5,
)  # fmt: skip
VESSEL = Kind(
    "vessel",
    ("x", "depth", "log_inner", "log_wall", "log_ratio", "pressure", "swing", "narrowing",
     "log_plaque"),
    (-3.6, 0.7, np.log(0.36), np.log(0.09), np.log(4.0), 0.13, 0.05, 0.0, np.log(1.5)),
    (3.6, 2.9, np.log(1.3), np.log(0.20), np.log(100.0), 0.30, 0.175, 0.7, np.log(12.0)),
    _vessel_coordinates, _vessel_size, _vessel_radius, _widened, degree=4, beats=True,
)  # fmt: skip
KINDS = (LUMP, VESSEL)
