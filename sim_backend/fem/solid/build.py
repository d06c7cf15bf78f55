"""From a solid scene to its meshed body: the section is meshed once, extruded, then bent."""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array, Bools, Ints
from sim_backend.fem.contact.finger_gaps import skin_of
from sim_backend.fem.mesh import TISSUE
from sim_backend.fem.model import (
    CHORD,
    LOCKING_POISSON,
    Grading,
    build_section,
    materials,
)
from sim_backend.fem.newton import CannotSolve
from sim_backend.fem.section import Section
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.courses import across, end_thrust
from sim_backend.fem.solid.finger import solid_finger
from sim_backend.fem.solid.layers import graded_edges
from sim_backend.fem.solid.lumen_faces import lumen_faces
from sim_backend.fem.solid.prism import extrude, planes_of, wedges_of
from sim_backend.fem.solid.warp import BALL_CORE, REACH, cylinder_to_ball
from sim_backend.fem.support import HOLD_WIDTH_M
from sim_backend.scene.inclusion import Artery, Inclusion, Tumour
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.slicing import is_symmetric_along
from sim_backend.scene.table import beyond_a_file

SHARE = 0.36
"""Element size in the contact over the finger's smaller half width."""
GROWTH, COARSEST, WALL = 0.55, 0.33, 0.5
"""At that size: how fast elements grow away from contact and inclusions, the largest over the
block's height, and those at an inclusion over its radius. With two thirds of all of these TIHA
under a ball of 5 mm is within 0.3 % of CalculiX in force and 0.1 % in pulse."""
EDGE, EDGE_GROWTH = 0.75, 0.9
"""Layers where a finger's end is rounded, over the radius of that, on the mesh of `SHARE`; and how
fast they grow from there. One node on an end of 1 mm between layers of 1.8 mm carries so much that
it slides over it: TIHA in 30 mm, a cylinder 12 mm beside the vessel, gives a pulse 20 % smaller
than with these layers, which are a fifth of the unknowns more, or with still finer ones."""
FAR = 1.5
"""How far from where elements are largest they grow on, over the block's height. Without that, thin
wide blocks were refused: a ball on 66 x 67 x 8 mm makes 104,339 unknowns in place of 57,391, for
0.06 % of the force; a cylinder across an artery, 86 x 78 x 11 mm, 69,300 in place of 47,539, for
0.2 % of the force and 0.1 % of the pulse. With 1.0 a quarter fewer, and 0.12, 0.16 and 0.2 %."""
SLOWER, AWAY_FROM = 0.8, 0.69
"""Power of the contact's element size with which the others shrink; and that size, over `SHARE`'s,
below which those away from contact and inclusions shrink no more: the second mesh of a press (0.25
over 0.36) is just above it. Five vessels in a small block
(`benchmarks/equal_error.py` at c51866cd) are 0.19 % off in force and 0.39 % in pulse on the third
mesh (root mean squares), 0.21 and 0.56 % where they go on; it has a quarter fewer unknowns, and two
fifths fewer for TIHA in 64 x 40 mm."""
MOST_UNKNOWNS = 85_000
"""No mesh much above this is solved: of TIHA-solid 64,169 unknowns take 1.14 GB."""
LEAST_LAYER = 0.01
"""No layer is made thinner than this share of the outer radius of a stenosed vessel: the stretch's
end is moved onto what is nearer. An end 0.1 um from the finger made the tangent singular; one
20 um from it, of a vessel of 2 mm, changes the pulse by 0.6 %."""
HOLD_STIFFNESS = 100.0
"""Stiffness that fixes an average, over the tissue's modulus times the width of the hold."""


@dataclass(frozen=True)
class _Span:
    """The modelled stretch along z [m]; the finger is at 0."""

    low: float
    high: float

    @property
    def halved(self) -> bool:
        return self.low == 0.0


def build_body(
    scene: Scene,
    x_m: float,
    *,
    depth_m: float,
    size_m: float,
    most_unknowns: float = MOST_UNKNOWNS,
) -> SolidBody:
    """Mesh a solid ``scene`` for a press at (``x_m``, z = 0) about ``depth_m`` deep.

    ``size_m`` is the element size in the contact. Where the scene is symmetric about z = 0, one
    half is modelled. Raises `SceneError` where inclusions leave no room for elements or lie behind
    each other, and where elements would lock; `CannotSolve` for more than ``most_unknowns``.
    """
    tissue = scene.tissue
    assert tissue is not None and tissue.length_mm is not None  # the scene was checked
    _refuse_locking(scene)
    drawn = _as_at_finger(scene)
    _refuse_behind(drawn)
    half_m = 0.5e-3 * tissue.length_mm
    middle_m = 1e-3 * (tissue.z_mm or 0.0)
    span = _Span(0.0 if is_symmetric_along(scene) else middle_m - half_m, middle_m + half_m)
    grading = grading_of(scene, size_m)
    flat = section_scene(drawn)
    section = build_section(
        flat, x_m, depth_m=depth_m, size_m=size_m, element="T6", grading=grading
    )
    edges = _edges(scene, span, depth_m, grading)
    nodes, cells = extrude(section.mesh.nodes, section.mesh.cells, edges)
    solid = _solid_part(scene, section, edges)
    placed = nodes.copy()
    if any(one.path for one in scene.arteries):
        placed[:, :2] = across(scene, section.mesh, planes_of(edges)).reshape(-1, 2)
    placed = _bent(scene, placed)
    wedges_at = cells[solid]
    try:
        wedges = wedges_of(placed, wedges_at)
    except ValueError as error:
        raise SceneError(
            f"{scene.name}: inclusions leave no room for elements: {error}. {_least_room(drawn)}. "
            "Move inclusions further from each other, also as seen along z, and from the "
            "block's surfaces, sides and ends."
        ) from None
    region = _regions(scene, section, edges)[solid]
    shear, bulk = materials(flat, region)
    surface = np.flatnonzero(np.abs(nodes[:, 1] - 1e-3 * scene.surface_mm) < 1e-9)
    lumens = tuple(
        faces
        for n, one in enumerate(drawn.inclusion)
        if isinstance(one, Artery)
        for faces in lumen_faces(section, cells, solid, one, n, scene)
    )
    body = SolidBody(
        wedges, region, shear, bulk,
        _held(scene, nodes, span), lumens, surface, _leaning(scene, placed, span),
        solid_finger(scene.indenter, x_m, 1e-3 * scene.surface_mm),
        0.5 if span.halved else 1.0, size_m, 1e3 * tissue.modulus_kpa,
        (section.mesh.nodes, planes_of(edges)), _thrust(scene, section, placed, span),
        scene.indenter.bonded, *skin_of(scene.indenter),
    )  # fmt: skip
    if len(body.free) > most_unknowns:
        raise CannotSolve(
            "mesh",
            f"{scene.name}: elements of {1e3 * size_m:.2g} mm under the finger make "
            f"{len(body.free)} unknowns; at most {most_unknowns:.0f} are solved here, so that the "
            "largest mesh takes 1.5 GB. Take a larger finger, or a smaller or thicker block.",
        )
    return body


def _as_at_finger(scene: Scene) -> Scene:
    """The scene with vessels straight on from where they are at z = 0: what is drawn along z."""
    inclusion: list[Inclusion] = []
    for one in scene.inclusion:
        x_mm, depth_mm = one.centre_mm(0.0)
        straight = {"path": ()} if isinstance(one, Artery) else {}
        inclusion.append(one.model_copy(update={"x_mm": x_mm, "depth_mm": depth_mm, **straight}))
    return beyond_a_file(scene, {"inclusion": tuple(inclusion)})


def grading_of(scene: Scene, size_m: float) -> Grading:
    """Element sizes where those in the contact are ``size_m``."""
    assert scene.tissue is not None
    finer = size_m / (SHARE * half_width_m(scene))
    wall, away = min(WALL * finer**SLOWER, WALL), max(finer, AWAY_FROM) ** SLOWER
    return Grading(
        size_m, lambda radius_m: wall * radius_m, min(GROWTH * away, 0.9),
        min(COARSEST * away, 0.5) * 1e-3 * scene.tissue.height_mm,
        far_m=np.inf if any(one.path for one in scene.arteries)
        else FAR * 1e-3 * scene.tissue.height_mm,
    )  # fmt: skip


def half_width_m(scene: Scene) -> float:
    """The finger's smaller half width [m]."""
    return min(scene.indenter.profile.scale, scene.indenter.ends.scale)


def _refuse_locking(scene: Scene) -> None:
    """Wedges of full integration lock where volume is all but kept. Raises `SceneError`."""
    for key, one in (
        ("tissue", scene.tissue),
        *((f"inclusion {n + 1}", one) for n, one in enumerate(scene.inclusion)),
    ):
        if one is not None and one.poisson > LOCKING_POISSON:
            raise SceneError(
                f"{scene.name}: {key}: poisson = {one.poisson:g}: a solid's elements lock above "
                f"{LOCKING_POISSON:g} and would give too large a force. Write at most "
                f"{LOCKING_POISSON:g}, or press by a round finger over nothing or over the middle "
                "of one ball, which the axisymmetric model solves at any Poisson's ratio."
            )


def _refuse_behind(scene: Scene) -> None:
    """One section is drawn along z: balls behind each other overlap in it. Raises `SceneError`."""
    for n, one in enumerate(scene.inclusion):
        for m, other in enumerate(scene.inclusion[:n]):
            aside_mm = float(np.hypot(one.x_mm - other.x_mm, one.depth_mm - other.depth_mm))
            room_mm = one.outer_radius_mm + other.outer_radius_mm
            if aside_mm <= room_mm:
                raise SceneError(
                    f"{scene.name}: inclusion[{m}] and inclusion[{n}] lie behind each other, "
                    f"{aside_mm:.3g} mm apart as seen along z: a solid's mesh is one section drawn "
                    f"along z, in which they would overlap. Move one aside until they are more "
                    f"than {room_mm:g} mm apart in x and depth."
                )


def _least_room(scene: Scene) -> str:
    """Where least room is left for elements, as seen along z or at an end, and by which key."""
    assert scene.tissue is not None
    width_mm, length_mm = scene.tissue.width_mm, scene.tissue.length_mm or np.inf
    left: list[tuple[float, int, str, str]] = []
    for n, one in enumerate(scene.inclusion):
        r = one.outer_radius_mm
        left.append((one.depth_mm - r, n, "depth_mm", "the surface"))
        left.append((scene.surface_mm - one.depth_mm - r, n, "depth_mm", "the bottom"))
        left.append((min(one.x_mm, width_mm - one.x_mm) - r, n, "x_mm", "a side"))
        if isinstance(one, Tumour):
            off_mm = abs(one.z_mm or 0.0)
            left.append((length_mm / 2 - off_mm - r, n, "z_mm", "an end of the block"))
        for m, other in enumerate(scene.inclusion[:n]):
            aside_mm = float(np.hypot(one.x_mm - other.x_mm, one.depth_mm - other.depth_mm))
            room_mm = aside_mm - r - other.outer_radius_mm
            left.append((room_mm, n, "x_mm or depth_mm", f"inclusion[{m}]"))
    left_mm, n, key, beside = min(left)
    return f"inclusion[{n}].{key}: {left_mm:.2g} mm lie between inclusion[{n}] and {beside}"


def section_scene(scene: Scene) -> Scene:
    """A plane scene whose mesh can be extruded: lumps as cylinders that will become balls."""
    assert scene.tissue is not None
    tissue = scene.tissue.model_copy(update={"length_mm": None, "ends": None, "z_mm": None})
    inclusion = tuple(
        one.model_copy(update={"diameter_mm": BALL_CORE * one.diameter_mm})
        if isinstance(one, Tumour)
        else one
        for one in scene.inclusion
    )
    return beyond_a_file(scene, {"plane": "strain", "tissue": tissue, "inclusion": inclusion})


def _edges(scene: Scene, span: _Span, depth_m: float, grading: Grading) -> Array:
    """Edges of the layers [m]."""
    # to where an end's chord reaches: as far as it touches, as along x, would cost a quarter more
    # layers of a cylinder, whose forces are within 0.5 and pulses within 1.4 % of CalculiX' so
    along = scene.indenter.ends
    face, rounding = along.chord(0.0), along.rounding
    reach = face + CHORD * (along.chord(max(depth_m, 1e-4)) - face)
    spots: list[tuple[float, float]] = []  # (z, element size there)
    ends: list[tuple[float, float]] = []  # (z, how near to it a layer may end) of stenoses
    for one in scene.inclusion:
        wall = grading.at_wall(1e-3 * one.outer_radius_mm)
        if isinstance(one, Tumour):
            core = BALL_CORE * 0.5e-3 * one.diameter_mm
            middle = 1e-3 * (one.z_mm or 0.0)
            spots += [(middle - core, wall), (middle + core, wall)]
        elif one.stenosis is not None and one.stenosis.z_mm is not None:
            spots += [(1e-3 * z, wall) for z in one.stenosis.z_mm]
            nearest = LEAST_LAYER * 1e-3 * one.outer_radius_mm
            ends += [(1e-3 * z, nearest) for z in one.stenosis.z_mm]

    def size(z: Array) -> Array:
        away = np.abs(z)
        beyond = np.maximum(away - reach, 0.0)
        if rounding is not None:  # nor in the middle of a face
            beyond = np.maximum(beyond, 2 * rounding[0] - rounding[1] - away)
        wanted = grading.contact_m + grading.growth * beyond
        if rounding is not None:
            radius = rounding[1] - rounding[0]
            edge = EDGE * radius * grading.contact_m / (SHARE * half_width_m(scene))
            end = np.clip(away, rounding[0], rounding[0] + 0.8 * radius)
            wanted = np.minimum(wanted, edge + EDGE_GROWTH * np.abs(away - end))
        for spot, wall in spots:
            wanted = np.minimum(wanted, wall + grading.growth * np.abs(z - spot))
        return grading.bounded(wanted)

    movable = {z for z, _ in ends}
    breaks = {span.low, span.high, *(z for z, _ in spots if z not in movable)}
    breaks |= set() if span.halved else {0.0}
    for z, nearest in ends:
        if all(abs(z - other) > nearest for other in breaks):
            breaks.add(z)
    inner = (z for z in breaks if span.low < z < span.high)
    return graded_edges([span.low, *sorted(inner), span.high], size)


def _solid_part(scene: Scene, section: Section, edges: Array) -> Bools:
    """Which wedges (l, m) exist: a stenosis lies in its stretch only, else there is lumen."""
    middle = (edges[1:] + edges[:-1]) / 2
    solid = np.ones((len(middle), len(section.mesh.cells)), dtype=bool)
    for n, one in enumerate(scene.inclusion):
        ring = one.stenosis if isinstance(one, Artery) else None
        if ring is not None and ring.z_mm is not None:
            outside = (middle < 1e-3 * ring.z_mm[0]) | (middle > 1e-3 * ring.z_mm[1])
            solid &= ~(outside[:, None] & (section.mesh.region == 2 + 2 * n))
    return solid


def _regions(scene: Scene, section: Section, edges: Array) -> Ints:
    """Region (l, m) of each wedge: a lump's cylinder ends, beyond it is tissue."""
    middle = (edges[1:] + edges[:-1]) / 2
    region = np.tile(section.mesh.region, (len(middle), 1))
    for n, one in enumerate(scene.inclusion):
        if isinstance(one, Tumour):
            core = BALL_CORE * 0.5e-3 * one.diameter_mm
            beyond = np.abs(middle - 1e-3 * (one.z_mm or 0.0)) > core
            region[beyond[:, None] & (region == 1 + 2 * n)] = TISSUE
    return region


def _bent(scene: Scene, nodes: Array) -> Array:
    placed = nodes
    for one in scene.inclusion:
        if isinstance(one, Tumour):
            centre = 1e-3 * np.array([one.x_mm, scene.surface_mm - one.depth_mm, one.z_mm or 0.0])
            room = 1e-3 * _room_mm(scene, one)
            placed = cylinder_to_ball(placed, centre, 0.5e-3 * one.diameter_mm, room)
    return placed


def _room_mm(scene: Scene, one: Tumour) -> float:
    """How far from a lump's centre nothing else is: sides, ends, other inclusions."""
    tissue = scene.tissue
    assert tissue is not None and tissue.length_mm is not None
    room = [one.depth_mm, tissue.height_mm - one.depth_mm, one.x_mm, tissue.width_mm - one.x_mm,
            tissue.length_mm / 2 - abs((one.z_mm or 0.0) - (tissue.z_mm or 0.0))]  # fmt: skip
    near_z_mm = (one.z_mm or 0.0) + REACH * one.outer_radius_mm * np.linspace(-1, 1, 21)
    room += [
        float(np.hypot(*np.subtract(other.centre_mm(z_mm), (one.x_mm, one.depth_mm))))
        - other.outer_radius_mm
        for other in scene.inclusion
        if other is not one
        for z_mm in near_z_mm
    ]
    return 0.98 * min(room)


def _held(scene: Scene, nodes: Array, span: _Span) -> Ints:
    """The bottom rests on its support, and may stick to it; symmetry and fixed ends keep their
    places along z."""
    assert scene.tissue is not None
    bottom = np.flatnonzero(nodes[:, 1] < 1e-9)
    fixed = [3 * bottom + axis for axis in ((0, 1, 2) if scene.bonded_support else (1,))]
    levels = [span.low] if span.halved else []
    if scene.tissue.ends == "held":
        levels += [span.low, span.high]
    fixed += [3 * np.flatnonzero(np.abs(nodes[:, 2] - z) < 1e-9) + 2 for z in levels]
    return np.unique(np.concatenate(fixed))


def _leaning(scene: Scene, nodes: Array, span: _Span) -> tuple[tuple[float, Array], ...]:
    """The bottom's middle slides on its support not at all, on average, nor does a wide part turn:
    a vessel that leaves through free ends obliquely twists the block, and a narrow part with it."""
    tissue = scene.tissue
    assert tissue is not None and tissue.length_mm is not None
    off = nodes[:, [0, 2]] - 1e-3 * np.array([tissue.width_mm / 2, tissue.z_mm or 0.0])
    bottom = nodes[:, 1] < 1e-9
    stiffness = HOLD_STIFFNESS * 1e3 * tissue.modulus_kpa * HOLD_WIDTH_M

    def bell(width_m: float) -> Array:
        found = np.where(bottom, np.exp(-0.5 * (np.hypot(*off.T) / width_m) ** 2), 0.0)
        return np.asarray(np.where(found > 1e-3, found, 0.0) / found[found > 1e-3].sum())

    middle = bell(HOLD_WIDTH_M)
    ways = [np.column_stack([middle, 0 * middle, 0 * middle])]
    if not span.halved and tissue.ends != "held":
        wide_m = 0.25e-3 * min(tissue.width_mm, tissue.length_mm)
        wide = bell(wide_m)
        turn = np.column_stack([off[:, 1], 0 * wide, -off[:, 0]]) / wide_m
        ways += [np.column_stack([0 * middle, 0 * middle, middle]), wide[:, None] * turn]
    return tuple((stiffness, way.ravel()) for way in ways)


def _thrust(scene: Scene, section: Section, placed: Array, span: _Span) -> Array:
    """Forces per pressure (3n,) [m2] by which the rest of each vessel holds its free ends."""
    assert scene.tissue is not None
    count = len(section.mesh.nodes)
    found = np.zeros_like(placed)
    for n, one in enumerate(scene.inclusion):
        if not isinstance(one, Artery) or not one.path or scene.tissue.ends == "held":
            continue
        wall = np.unique(section.mesh.cells[section.mesh.region == 1 + 2 * n])
        for z_m, first in ((span.high, len(placed) - count), (span.low, 0)):
            if z_m != 0.0 or not span.halved:
                end = end_thrust(one, 1e3 * z_m) * np.sign(z_m)
                found[first + wall] += end / len(wall)
    return found.ravel()
