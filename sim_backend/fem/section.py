"""A scene's plane section as a meshed elastic body: materials, support, lumens, finger."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim_backend.fem.assembly import Assembly
from sim_backend.fem.contact import Finger, finger_over
from sim_backend.fem.elements import Cells, as_element
from sim_backend.fem.lumen import Sides, lumen_sides
from sim_backend.fem.material import moduli
from sim_backend.fem.mesh import TISSUE, Mesh, Ring, block_mesh, ring_mesh
from sim_backend.scene import Artery, Inclusion, Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

COARSEST_M = 2.4e-3


@dataclass(frozen=True)
class Section:
    """``shear`` and ``bulk`` (m,) [Pa] per cell; ``held`` displacement numbers are zero.

    ``tissue_pa`` is the modulus that scales tolerances.
    """

    mesh: Mesh
    cells: Cells
    shear: Array
    bulk: Array
    plane_stress: bool
    held: Ints
    lumens: tuple[Sides, ...]
    finger: Finger
    tissue_pa: float

    @property
    def size(self) -> int:
        return 2 * len(self.mesh.nodes)

    @cached_property
    def touching(self) -> Ints:
        """(t,) nodes that the finger, and after them those that the support, may touch."""
        return np.concatenate([self.mesh.surface, self.mesh.resting])

    @cached_property
    def touching_dofs(self) -> Ints:
        """(t, 2)"""
        return np.stack([2 * self.touching, 2 * self.touching + 1], axis=1)

    def gaps(self, finger: Finger, u: Array) -> tuple[Array, Array, Array]:
        """Gap (t,) [m], normal (t, 2) out of the rigid body and curvature (t,) [1/m]."""
        place = self.mesh.nodes[self.touching] + u[self.touching]
        top = len(self.mesh.surface)
        gap, normal, curvature = finger.gap(place[:top])
        rest = len(place) - top
        return (
            np.concatenate([gap, place[top:, 1]]),
            np.vstack([normal, np.tile([0.0, 1.0], (rest, 1))]),
            np.concatenate([curvature, np.zeros(rest)]),
        )

    @cached_property
    def assembly(self) -> Assembly:
        """Groups of blocks: cells, touching nodes, then each lumen's sides."""
        groups = [self.cells.dofs, self.touching_dofs, *(s.dofs for s in self.lumens)]
        return Assembly(self.size, groups, self.held)


def build_section(
    scene: Scene, x_m: float, *, depth_m: float, size_m: float, element: str = "T6"
) -> Section:
    """Mesh ``scene`` for a press at ``x_m`` about ``depth_m`` deep.

    ``size_m`` is the element size under the finger and round inclusions; away from both it
    grows. Raises ValueError for an unknown element.
    """
    rings = [_ring(one, scene, n) for n, one in enumerate(scene.inclusion)]
    surface_m = 1e-3 * scene.surface_mm
    finger = finger_over(scene.indenter, x_m, surface_m)
    reach = _half_contact(finger, depth_m)

    def size(points: Array) -> Array:
        return _sizes(points, finger, reach, rings, size_m)

    if scene.tissue is None:
        plain = ring_mesh(rings[0], lambda p: np.full(len(p), size_m / 1.5))
    else:
        plain = block_mesh(1e-3 * scene.tissue.width_mm, surface_m, rings, size)
    mesh, cells = as_element(plain, element)
    shear, bulk = _materials(scene, rings, mesh.region)
    stress = scene.plane == "stress"
    modulus_kpa = (scene.tissue or scene.inclusion[0]).modulus_kpa
    sides = lumen_sides(mesh, cells, shear, bulk, stress)
    held = _held(mesh, scene)
    return Section(mesh, cells, shear, bulk, stress, held, sides, finger, 1e3 * modulus_kpa)


def homogeneous(scene: Scene) -> Scene:
    """The scene with nothing in it."""
    return scene.model_copy(update={"inclusion": ()})


def _ring(one: Inclusion, scene: Scene, n: int) -> Ring:
    """Regions: 0 tissue, 1 + 2n the inclusion (or vessel wall), 2 + 2n its stenosis."""
    alone = scene.tissue is None
    height = one.outer_radius_mm if alone else scene.surface_mm - one.depth_mm
    centre = (1e-3 * one.x_mm, 1e-3 * height)
    outer = 1e-3 * one.outer_radius_mm
    if not isinstance(one, Artery):
        return Ring(centre, (outer,), (1 + 2 * n,), hollow=False)
    inner = 0.5e-3 * one.inner_diameter_mm
    if one.stenosis is None:
        return Ring(centre, (outer, inner), (1 + 2 * n,), hollow=True)
    narrow = inner * (1 - one.stenosis.fraction)
    return Ring(centre, (outer, inner, narrow), (1 + 2 * n, 2 + 2 * n), hollow=True)


def _materials(scene: Scene, rings: list[Ring], region: Ints) -> tuple[Array, Array]:
    table = np.full((1 + 2 * len(rings), 2), np.nan)
    if scene.tissue is not None:
        table[TISSUE] = moduli(1e3 * scene.tissue.modulus_kpa, scene.tissue.poisson)
    for n, one in enumerate(scene.inclusion):
        table[1 + 2 * n] = moduli(1e3 * one.modulus_kpa, one.poisson)
        if isinstance(one, Artery) and one.stenosis is not None:
            table[2 + 2 * n] = moduli(1e3 * one.stenosis.modulus_kpa, one.poisson)
    return table[region, 0], table[region, 1]


def _held(mesh: Mesh, scene: Scene) -> Ints:
    """A block rests on its bottom and is pinned sideways at one node; a lone ring is glued."""
    if scene.tissue is None:
        return np.sort(np.concatenate([2 * mesh.bottom, 2 * mesh.bottom + 1]))
    middle = np.median(mesh.nodes[mesh.bottom, 0])
    pin = mesh.bottom[np.argmin(np.abs(mesh.nodes[mesh.bottom, 0] - middle))]
    return np.sort(np.append(2 * mesh.bottom + 1, 2 * pin))


def _half_contact(finger: Finger, depth_m: float) -> float:
    """Half of the width that a press is expected to touch [m]."""
    sunk = min(max(depth_m, 1e-4), finger.radius)
    return finger.half_flat + 0.85 * float(np.sqrt(2 * finger.radius * sunk - sunk**2))


def _sizes(points: Array, finger: Finger, reach: float, rings: list[Ring], size_m: float) -> Array:
    """Element size (n,) [m]: ``size_m`` in the contact and at inclusions, growing away from them."""
    across = np.maximum(np.abs(points[:, 0] - finger.x) - reach, 0.0)
    away = np.hypot(across, points[:, 1] - finger.y)
    wanted = size_m + 0.35 * away
    for ring in rings:
        gap = np.abs(np.hypot(*(points - ring.centre).T) - ring.radii[0])
        at_wall = min(1.6 * size_m, 0.5 * ring.radii[0])
        wanted = np.minimum(wanted, at_wall + 0.35 * gap)
    return np.minimum(wanted, COARSEST_M)
