"""A section's mesh in a slightly different scene: its nodes follow surfaces, circles and finger."""

from dataclasses import replace

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.contact.finger_gaps import finger_over
from sim_backend.fem.elements import placed
from sim_backend.fem.lumen import lumen_sides
from sim_backend.fem.mesh import TINY_M
from sim_backend.fem.model import materials, ring_of
from sim_backend.fem.section import Section
from sim_backend.scene.scene_file import Scene


def redrawn(section: Section, drawn: Scene, other: Scene) -> Section:
    """The ``section`` of the scene ``drawn`` as one of the scene ``other``, on the same mesh.

    What each lumen's walls may meet, and what holds the body, stay as they are.
    """
    mesh, cells = section.mesh, section.cells
    shear, bulk = materials(other, mesh.region)
    if (nodes := followed(mesh.nodes, drawn, other)) is not mesh.nodes:
        mesh = replace(mesh, nodes=nodes)
        cells = placed(cells, nodes)
    finger = finger_over(other.indenter, section.finger.x, 1e-3 * other.surface_mm)
    sides = lumen_sides(mesh, cells, shear, bulk, section.plane_stress)
    moved = replace(
        section, mesh=mesh, cells=cells, shear=shear, bulk=bulk, finger=finger, lumens=sides
    )
    if section.self_contact:
        vars(moved)["walls"] = section.walls
    return moved


def followed(nodes: Array, drawn: Scene, other: Scene) -> Array:
    """Where ``nodes`` (n, 2) [m] are in another scene; the same array where none moves.

    A circle's nodes stay on it, and those of the block's outline on that. Between them the moves
    are weighted by the inverse of the distance (Shepard 1968), so that each surface has its own; a
    scene of another size moves as a whole.
    """
    rings = [
        (ring_of(old, drawn, n), ring_of(new, other, n))
        for n, (old, new) in enumerate(zip(drawn.inclusion, other.inclusion, strict=True))
    ]
    before, after = drawn.tissue, other.tissue
    if all(old == new for old, new in rings) and before == after:
        return nodes
    size = np.array([before.width_mm, before.height_mm]) * 1e-3 if before else np.ones(2)
    grown = np.array([after.width_mm, after.height_mm]) * 1e-3 - size if after else np.zeros(2)
    moves = [nodes * grown / size] if before else []
    away = [np.minimum(nodes, size - nodes).min(axis=1)] if before else []
    for old, new in rings:
        rel = nodes - old.centre
        rho = np.hypot(*rel.T)
        there = np.interp(rho, [0.0, *old.radii[::-1]], [0.0, *new.radii[::-1]])
        there *= np.maximum(rho / old.radii[0], 1.0)
        outward = rel / np.maximum(rho, TINY_M)[:, None]
        moves.append(np.subtract(new.centre, old.centre) + (there - rho)[:, None] * outward)
        away.append(rho - old.radii[0])
    # on a surface, and within a circle, its own move alone
    weights = 1 / np.maximum(away, TINY_M)
    weights /= weights.sum(axis=0)
    return np.asarray(nodes + np.einsum("kn,kni->ni", weights, moves))
