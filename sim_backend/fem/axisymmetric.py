"""A round finger over the middle of a round block, over nothing or over a ball below it."""

from dataclasses import replace
from math import isclose

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.contact.finger_gaps import finger_over
from sim_backend.fem.elements import as_element
from sim_backend.fem.finite_strain import Solved, pressed
from sim_backend.fem.mesh import block_mesh
from sim_backend.fem.model import (
    Grading,
    best_element,
    element_sizes,
    half_contact,
    materials,
    ring_of,
)
from sim_backend.fem.revolved import revolved
from sim_backend.fem.section import Section
from sim_backend.fem.support import SlidingConstraint
from sim_backend.scene.inclusion import Tumour
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.table import beyond_a_file


def is_round(scene: Scene, x_m: float) -> bool:
    """Whether a press at ``x_m`` is a body of revolution but for the block's outline."""
    centred = all(
        isinstance(one, Tumour) and isclose(1e-3 * one.x_mm, x_m, abs_tol=1e-12) and not one.z_mm
        for one in scene.inclusion
    )
    finger = scene.indenter.turns and scene.indenter.skin is None
    return finger and centred and len(scene.inclusion) <= 1


def solve_axisymmetric(
    scene: Scene, radius_m: float, depth_m: float, grading: Grading, coarser: Solved | None = None
) -> Solved:
    """The press ``depth_m`` deep into a block of ``radius_m``; its force is the whole finger's [N].

    With what was solved on a ``coarser`` mesh, or for another radius, the way down need not be gone
    again, but by a bonded finger. Raises `CannotSolve`.
    """
    section = build_axisymmetric(scene, radius_m, depth_m, grading)
    half_m = scene.indenter.profile.scale
    return section, pressed(section, half_m, depth_m, [0.0], coarser=coarser)


def build_axisymmetric(scene: Scene, radius_m: float, depth_m: float, grading: Grading) -> Section:
    """The half section right of the axis x = 0, turned about it; T6, or Q4M where that locks."""
    assert scene.tissue is not None  # the scene was checked
    inclusion = tuple(one.model_copy(update={"x_mm": 0.0}) for one in scene.inclusion)
    moved = beyond_a_file(scene, {"inclusion": inclusion})  # onto the axis
    height_m = 1e-3 * scene.surface_mm
    finger = finger_over(scene.indenter, 0.0, height_m)
    half_m = half_contact(finger, depth_m)
    rings = [ring_of(one, moved, n) for n, one in enumerate(inclusion)]

    def size(points: Array) -> Array:
        return element_sizes(points, finger, half_m, rings, grading)

    mesh, cells = as_element(block_mesh(radius_m, height_m, rings, size), best_element(scene))
    shear, bulk = materials(moved, mesh.region)
    on_axis = np.flatnonzero(mesh.nodes[:, 0] < 1e-12)
    aside = [2 * mesh.bottom] if scene.bonded_support else []
    fixed = np.unique(np.concatenate([2 * on_axis, 2 * mesh.bottom + 1, *aside]))
    nothing = SlidingConstraint(np.empty((1, 0), dtype=np.int64), np.empty(0), 0.0)
    return Section(
        replace(mesh, lumens=()), revolved(cells, mesh.nodes), shear, bulk, False, fixed, (),
        finger, 1e3 * scene.tissue.modulus_kpa, nothing,
    )  # fmt: skip
