"""What a body rests on: rigid, flat, bonded or frictionless; a block may be free to lift."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.mesh import Mesh
from sim_backend.scene.scene_file import Scene

HOLD_WIDTH_M = 2.4e-3
"""Standard deviation of the stretch of bottom that is fixed along x."""
HOLD_STIFFNESS = 1e4
"""Stiffness of that hold over the tissue's modulus."""
PRESSED_SHARE = 0.5
"""Half of the width of bottom under the finger that is fixed also where a block may lift, over the
block's height. It is pressed in any case (TI's bottom is first pulled 21 mm, 1.25 heights, aside
of the finger), and stops the block falling."""

FLANK_SHARE = 0.25
"""Half of the height of a lone vessel's flanks over its radius."""


@dataclass(frozen=True)
class SlidingConstraint:
    """A block can slide on its support; the middle of its bottom does not, on average.

    ``dofs`` (1, k) with ``weight`` (k,) that sum to 1. A single fixed node would carry the finger's
    force along x at a point, and the answer would depend on the mesh (by 0.5 % near an edge).
    """

    dofs: Ints
    weight: Array
    stiffness_pa: float

    @cached_property
    def block(self) -> Array:
        return np.asarray(self.stiffness_pa * np.outer(self.weight, self.weight)[None])

    def force(self, u: Array) -> Array:
        """(1, k) [N/m] that the body must carry."""
        mean = float(self.weight @ u.ravel()[self.dofs[0]])
        return np.asarray((self.stiffness_pa * mean * self.weight)[None])


def supported(mesh: Mesh, scene: Scene, x_m: float) -> tuple[Mesh, Ints, SlidingConstraint]:
    """The mesh with the nodes that may come to rest on the support; displacement numbers that are
    fixed; and what keeps the body from sliding. The finger is at ``x_m``.

    A block rests on its bottom. A lone vessel is glued along its lowest arc, so that it cannot
    spin; and what it continues into along its length keeps it from rolling aside.
    """
    y, x = 2 * mesh.bottom + 1, 2 * mesh.bottom
    if scene.tissue is None:
        return mesh, np.sort(np.concatenate([x, y])), _held_on_average(mesh, scene)
    if scene.support.lifts:
        half_m = PRESSED_SHARE * 1e-3 * scene.tissue.height_mm
        pressed = np.abs(mesh.nodes[mesh.bottom, 0] - x_m) <= half_m
        mesh, y = replace(mesh, resting=mesh.bottom[~pressed]), y[pressed]
    fixed = np.sort(np.concatenate([x, y])) if scene.bonded_support else y
    return mesh, fixed, _sliding(mesh, 1e3 * scene.tissue.modulus_kpa)


def _held_on_average(mesh: Mesh, scene: Scene) -> SlidingConstraint:
    """The flanks of a lone vessel keep their place across the finger, on average. Without that, a
    finger over its middle balances on it, and where a pressed section thins unevenly the lumen's
    pressure alone tips it over."""
    radius = 1e-3 * scene.inclusion[0].outer_radius_mm
    x, y = (mesh.nodes - [1e-3 * scene.inclusion[0].x_mm, radius]).T
    outside = np.abs(np.hypot(x, y) - radius) < 1e-9
    flanks = np.flatnonzero(outside & (np.abs(y) <= FLANK_SHARE * radius))
    share = np.full(len(flanks), 1 / len(flanks))
    stiffness = HOLD_STIFFNESS * 1e3 * scene.inclusion[0].modulus_kpa
    return SlidingConstraint(2 * flanks[None], share, stiffness)


def _sliding(mesh: Mesh, modulus_pa: float) -> SlidingConstraint:
    x = mesh.nodes[mesh.bottom, 0]
    share = np.gradient(x) * np.exp(-0.5 * ((x - x.max() / 2) / HOLD_WIDTH_M) ** 2)
    near = share > 1e-3 * share.max()
    weight = share[near] / share[near].sum()
    return SlidingConstraint(2 * mesh.bottom[near][None], weight, HOLD_STIFFNESS * modulus_pa)
