"""The faces of a solid on which the pressure in a vessel acts."""

import numpy as np

from sim_backend.arrays import Bools, Ints
from sim_backend.fem.mesh import T6_EDGES
from sim_backend.fem.section import Section
from sim_backend.fem.solid.forces import Faces
from sim_backend.fem.solid.prism import quad_shape, triangle_shape
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.scene_file import Scene


def lumen_faces(
    section: Section, cells: Ints, solid: Bools, one: Artery, n: int, scene: Scene
) -> list[Faces]:
    """The faces on which a lumen's pressure acts: round it, and on a stenosis's two ends."""
    mesh = section.mesh
    centre = 1e-3 * np.array([one.x_mm, scene.surface_mm - one.depth_mm])
    distance = np.hypot(*(mesh.nodes - centre).T)
    inner = 0.5e-3 * one.inner_diameter_mm
    ring = mesh.region == 2 + 2 * n
    narrow = inner * (1 - one.stenosis.fraction) if one.stenosis is not None else inner
    # outside its stretch a stenosis is lumen, and the wall's inner circle bounds it
    around = [(narrow, ring if one.stenosis else mesh.region == 1 + 2 * n)]
    if one.stenosis is not None:
        around.append((inner, mesh.region == 1 + 2 * n))
    quads = []
    for radius, wall in around:
        for edge in T6_EDGES:
            on = wall & np.all(np.abs(distance[mesh.cells[:, edge]] - radius) < 1e-9, axis=1)
            bounds = solid & on
            if one.stenosis is not None and radius == inner:
                bounds = bounds & ~np.any(solid & ring, axis=1)[:, None]
            columns = [6 * plane + side for plane in range(3) for side in edge]
            quads.append(cells[bounds][:, columns])
    found = [Faces(np.concatenate(quads), *quad_shape())]
    caps = _caps(cells, solid, ring)
    if len(caps):
        found.append(Faces(caps, *triangle_shape()))
    return found


def _caps(cells: Ints, solid: Bools, ring: Bools) -> Ints:
    """Ends (s, 6) of a stenosis that face the lumen, seen from there clockwise."""
    here = solid & ring
    later = np.zeros_like(here)
    later[:-1] = ring & ~solid[1:]
    earlier = np.zeros_like(here)
    earlier[1:] = ring & ~solid[:-1]
    top, bottom = cells[here & later][:, 12:], cells[here & earlier][:, :6]
    return np.concatenate([top[:, [0, 2, 1, 5, 4, 3]], bottom])
