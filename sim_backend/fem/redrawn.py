"""A body's mesh in a slightly different scene: its nodes follow surfaces, circles and finger."""

from dataclasses import replace
from functools import singledispatch
from typing import Any

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.contact.finger_gaps import finger_over
from sim_backend.fem.elements import placed
from sim_backend.fem.lumen import lumen_sides
from sim_backend.fem.mesh import TINY_M
from sim_backend.fem.model import materials, ring_of
from sim_backend.fem.revolved import revolved
from sim_backend.fem.rings import Ring
from sim_backend.fem.section import Section
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.finger import solid_finger
from sim_backend.fem.solid.prism import wedges_of
from sim_backend.scene.inclusion import Artery, Tumour
from sim_backend.scene.scene_file import Scene, SceneError, Tissue


@singledispatch
def redrawn(body: Any, drawn: Scene, other: Scene) -> Any:
    """The ``body`` of the scene ``drawn`` as one of the scene ``other``, on the same mesh.

    What each lumen's walls may meet, and what holds the body, stay as they are. Raises
    `SceneError` for a vessel with a path of which more than the material is another.
    """
    raise NotImplementedError(type(body))


@singledispatch
def beside(body: Any, by_m: float) -> Any:
    """The body with its finger so far aside."""
    raise NotImplementedError(type(body))


@redrawn.register
def _(body: Section, drawn: Scene, other: Scene) -> Section:
    mesh, cells = body.mesh, body.cells
    shear, bulk = materials(other, mesh.region)
    turned = cells.hoop is not None
    if (nodes := followed(mesh.nodes, drawn, other, turned=turned)) is not mesh.nodes:
        mesh = replace(mesh, nodes=nodes)
        cells = placed(replace(cells, hoop=None), nodes)
        cells = revolved(cells, nodes) if turned else cells
    finger = finger_over(other.indenter, body.finger.x, 1e-3 * other.surface_mm)
    sides = lumen_sides(mesh, cells, shear, bulk, body.plane_stress)
    moved = replace(
        body, mesh=mesh, cells=cells, shear=shear, bulk=bulk, finger=finger, lumens=sides
    )
    if body.self_contact:
        vars(moved)["walls"] = body.walls
    return moved


@redrawn.register
def _(body: SolidBody, drawn: Scene, other: Scene) -> SolidBody:
    wedges = body.wedges
    shear, bulk = materials(other, body.region)
    if (nodes := followed(wedges.nodes, drawn, other)) is not wedges.nodes:
        wedges = wedges_of(nodes, wedges.cells)
    finger = solid_finger(other.indenter, float(body.finger.under_m[0]), 1e-3 * other.surface_mm)
    moved = replace(body, wedges=wedges, shear=shear, bulk=bulk, finger=finger)
    if body.self_contact:
        vars(moved)["walls"] = body.walls
    return moved


@beside.register
def _(body: Section, by_m: float) -> Section:
    return replace(body, finger=replace(body.finger, x=body.finger.x + by_m))


@beside.register
def _(body: SolidBody, by_m: float) -> SolidBody:
    under_m = body.finger.under_m + np.array([by_m, 0.0, 0.0])
    return replace(body, finger=replace(body.finger, under_m=under_m))


def followed(nodes: Array, drawn: Scene, other: Scene, *, turned: bool = False) -> Array:
    """Where ``nodes`` (n, d) [m] are in another scene; the same array where none moves.

    A circle's or ball's nodes stay on it, and those of the block's outline on that. Between them
    the moves are weighted by the inverse of the distance (Shepard 1968), so that each surface has
    its own; a scene of another size moves as a whole. Of a ``turned`` section x = 0 is no surface.
    """
    pairs = list(zip(drawn.inclusion, other.inclusion, strict=True))
    rings = [(ring_of(a, drawn, n), ring_of(b, other, n)) for n, (a, b) in enumerate(pairs)]
    before, after = drawn.tissue, other.tissue
    if all(a == b for a, b in rings) and before == after:
        return nodes
    if any(isinstance(one, Artery) and one.path for one in drawn.inclusion):
        raise SceneError(f"{drawn.name}: how a mesh moves with a vessel that has a path is unknown")
    if before is None or after is None:
        return _with_circle(nodes, *rings[0])[0]
    size, (middle, to) = _size_m(before, nodes), np.zeros((2, nodes.shape[1]))
    middle[2:], to[2:] = 1e-3 * (before.z_mm or 0.0), 1e-3 * (after.z_mm or 0.0)
    whole = to + (nodes - middle) * _size_m(after, nodes) / size
    sides = np.stack([nodes[:, 0], size[0] - nodes[:, 0], nodes[:, 1], size[1] - nodes[:, 1]])
    to_sides = sides[turned:].min(axis=0)
    moves, near, outline = [], [], []
    for (one, _), (old, new) in zip(pairs, rings, strict=True):
        z_m, ends = None, np.inf
        if nodes.shape[1] == 3 and isinstance(one, Tumour):
            z_m, ends = 1e-3 * (one.z_mm or 0.0), size[2] / 2 - np.abs(nodes[:, 2] - middle[2])
        moved, away = _with_circle(nodes, old, new, z_m)
        moved = np.hstack([moved, whole[:, moved.shape[1] :]])  # a vessel goes on along z
        moves.append(moved - whole)
        near.append(1 / np.maximum(away, TINY_M))
        outline.append(1 / np.maximum(np.minimum(to_sides, ends), TINY_M))
    # on a surface, and within a circle, its own move alone
    for move, own, beyond in zip(moves, near, outline, strict=True):
        whole = whole + (own / (sum(near) + beyond))[:, None] * move
    return np.asarray(whole)


def _size_m(tissue: Tissue, nodes: Array) -> Array:
    """Of the block, in as many directions as ``nodes`` have."""
    size_mm = (tissue.width_mm, tissue.height_mm, tissue.length_mm or 1.0)
    return 1e-3 * np.array(size_mm[: nodes.shape[1]])


def _with_circle(
    nodes: Array, old: Ring, new: Ring, z_m: float | None = None
) -> tuple[Array, Array]:
    """Where ``nodes`` are, in two directions or three, if all move as a circle, or a ball at
    ``z_m``, does; and how far (n,) they are from it, 0 or less within."""
    d = 2 if z_m is None else 3
    at, to = (np.array([*ring.centre, z_m or 0.0])[:d] for ring in (old, new))
    off = nodes[:, :d] - at
    rho = np.linalg.norm(off, axis=1)
    there = np.interp(rho, [0.0, *old.radii[::-1]], [0.0, *new.radii[::-1]])
    there *= np.maximum(rho / old.radii[0], 1.0)
    moved = to + off * (there / np.maximum(rho, TINY_M))[:, None]
    return moved, rho - old.radii[0]
