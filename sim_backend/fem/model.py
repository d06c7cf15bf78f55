"""A scene's plane section as a meshed elastic body: materials, support, lumens, finger."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.contact.finger_gaps import Finger, finger_over
from sim_backend.fem.elements import as_element
from sim_backend.fem.gaps import GAP_SHARE
from sim_backend.fem.lumen import lumen_sides
from sim_backend.fem.material import moduli
from sim_backend.fem.mesh import TISSUE, block_mesh, count_round, ring_mesh
from sim_backend.fem.rings import Ring
from sim_backend.fem.section import Section
from sim_backend.fem.support import supported
from sim_backend.scene.inclusion import Artery, Inclusion
from sim_backend.scene.scene_file import Scene

LOCKING_POISSON = 0.495
CHORD, ARC, DRAWN = 0.85, 0.75, 0.5
"""In 608 bare blocks of 6 to 80 mm (cylinders of 1 and 5 mm, flat fingers with edges of 0.2 to
1 mm, 0.1 to 4 mm deep, both planes, free and bonded supports) the contact is at most 0.99 times as
wide as `half_contact` says, aside of the middle of 16.83 mm of tissue at most 0.95 and under balls
0.94 (some of these in tests/sim_backend/fem/test_fingers.py). With the chord alone, and nothing
beyond the rounding, a flat finger's contact ended among elements up to ten times as large: pulses
were 9 % off where 0.4 % was stated."""
COARSEST_M = 2.4e-3
CONTACT_SHARE, GROWTH = 0.4, 0.45
"""Nodes that enter the contact one by one make the force jump; a finer surface keeps the jumps
below 0.03 % of it, and growing faster from there costs no more unknowns."""
LONE_FINER = 1.5
"""How much finer the elements of a lone vessel are than those asked for under the finger."""
FARTHEST = 3.0
"""How large elements grow far away, over `Grading.coarsest_m`. A ball of 4 mm on a block of 66 x 67
x 8 mm: with 2 as many unknowns and 0.2 % of the force less, with 6 a seventh fewer and 0.8 % more.
"""
FINEST_WALL = 0.05
"""Smallest element size at an inclusion over its radius."""


class Grading(NamedTuple):
    """Element sizes [m]: in the contact, at an inclusion of a radius [m], how fast they grow from
    there, and where that ends; the largest in a narrow gap over its width; and how far from where
    they ended growing they grow on, to `FARTHEST` times that size."""

    contact_m: float
    at_wall: Callable[[float], float]
    growth: float
    coarsest_m: float
    gap_share: float = GAP_SHARE
    far_m: float = np.inf

    def bounded(self, wanted: Array) -> Array:
        """Sizes (n,) that would grow without end, bounded near and far."""
        far = np.minimum(wanted - self.growth * self.far_m, FARTHEST * self.coarsest_m)
        return np.minimum(wanted, np.maximum(self.coarsest_m, far))


def build_section(
    scene: Scene,
    x_m: float,
    *,
    depth_m: float,
    size_m: float,
    element: str | None = None,
    along_surface: bool = False,
    grading: Grading | None = None,
) -> Section:
    """Mesh ``scene`` for a press at ``x_m`` about ``depth_m`` deep.

    ``size_m`` is the element size under the finger and round inclusions; away from both it
    grows; ``along_surface`` keeps it all along the surface. In a block ``grading`` says otherwise.
    Raises ValueError for an unknown element, `SceneError` for a solid scene.
    """
    scene.need_section("what was asked for knows")
    rings = [ring_of(one, scene, n) for n, one in enumerate(scene.inclusion)]
    surface_m = 1e-3 * scene.surface_mm
    finger = finger_over(scene.indenter, x_m, surface_m)
    half_m = np.inf if along_surface else half_contact(finger, depth_m)

    graded = grading or usual_grading(size_m)

    def size(points: Array) -> Array:
        return element_sizes(points, finger, half_m, rings, graded)

    if scene.tissue is None:
        plain = ring_mesh(rings[0], size_m / LONE_FINER)
    else:
        plain = block_mesh(1e-3 * scene.tissue.width_mm, surface_m, rings, size, graded.gap_share)
    mesh, cells = as_element(plain, element or best_element(scene))
    shear, bulk = materials(scene, mesh.region)
    stress = scene.plane == "stress"
    modulus_kpa = (scene.tissue or scene.inclusion[0]).modulus_kpa
    sides = lumen_sides(mesh, cells, shear, bulk, stress)
    mesh, fixed, sliding = supported(mesh, scene, x_m)
    return Section(
        mesh, cells, shear, bulk, stress, fixed, sides, finger, 1e3 * modulus_kpa, sliding,
        bonded_support=scene.bonded_support,
    )  # fmt: skip


def meshed_size_m(scene: Scene, size_m: float) -> float:
    """The ``size_m`` for which a mesh is as it is for this one: round a lone vessel lie multiples
    of a number of elements."""
    if scene.tissue is not None:
        return size_m
    ring = ring_of(scene.inclusion[0], scene, 0)
    return LONE_FINER * 2 * float(np.pi) * ring.radii[0] / count_round(ring, size_m / LONE_FINER)


def usual_grading(size_m: float) -> Grading:
    """Finest in the contact, about ``size_m`` at inclusions."""

    def at_wall(radius_m: float) -> float:
        # a finger that is tiny beside a vessel does not need the vessel any finer
        return float(np.clip(1.2 * size_m, FINEST_WALL * radius_m, 0.5 * radius_m))

    return Grading(CONTACT_SHARE * size_m, at_wall, GROWTH, COARSEST_M)


def best_element(scene: Scene) -> str:
    """``T6``, but ``Q4M`` where a nearly incompressible scene would make that lock: one in plane
    strain, or turned about an axis.

    In plane strain, at nu = 0.499 and 0.25 mm over a vessel, Q4M misses 0.2 % of the force and
    0.4 % of the pulse, T6M 0.7 and 1.6 %, T6 0.2 and 0.8 % in five times as many iterations.
    """
    solids = [one for one in (scene.tissue, *scene.inclusion) if one is not None]
    locking = scene.plane != "stress" and max(one.poisson for one in solids) > LOCKING_POISSON
    return "Q4M" if locking else "T6"


def ring_of(one: Inclusion, scene: Scene, n: int) -> Ring:
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


def materials(scene: Scene, region: Ints) -> tuple[Array, Array]:
    """Shear and bulk modulus (m,) [Pa] of cells by ``region`` (m,), numbered as by `ring_of`."""
    table = np.full((1 + 2 * len(scene.inclusion), 2), np.nan)
    if scene.tissue is not None:
        table[TISSUE] = moduli(1e3 * scene.tissue.modulus_kpa, scene.tissue.poisson)
    for n, one in enumerate(scene.inclusion):
        table[1 + 2 * n] = moduli(1e3 * one.modulus_kpa, one.poisson)
        if isinstance(one, Artery) and one.stenosis is not None:
            table[2 + 2 * n] = moduli(1e3 * one.stenosis.modulus_kpa, one.poisson)
    return table[region, 0], table[region, 1]


def half_contact(finger: Finger, depth_m: float) -> float:
    """Half of the undeformed width that a press is expected to touch at most [m].

    Beside a face that is a part of the chord that the surface cuts off the outline; deeper, of
    the arc that the surface wraps, and beyond the outline what it draws in along the flanks.
    """
    deep_m, outline = max(depth_m, 1e-4), finger.profile
    face_m, beyond_m = outline.chord(0.0), max(deep_m - outline.height, 0.0)
    chord_m, arc_m = outline.chord(deep_m) - face_m, outline.arc(deep_m) - face_m
    return face_m + max(CHORD * chord_m, ARC * arc_m) + DRAWN * beyond_m


def element_sizes(
    points: Array, finger: Finger, half_m: float, rings: list[Ring], grading: Grading
) -> Array:
    """Element size (n,) [m]."""
    across = np.maximum(np.abs(points[:, 0] - finger.x) - half_m, 0.0)
    away = np.hypot(across, points[:, 1] - finger.y)
    wanted = grading.contact_m + grading.growth * away
    for ring in rings:
        gap = np.abs(np.hypot(*(points - ring.centre).T) - ring.radii[0])
        wanted = np.minimum(wanted, grading.at_wall(ring.radii[0]) + grading.growth * gap)
    return grading.bounded(wanted)
