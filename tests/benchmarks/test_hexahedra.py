"""CalculiX' meshes of solids: exact volumes, whole surfaces, and decks that are the kept ones."""

import json
import lzma

import numpy as np
import pytest
from calculix_solids import CASES, FOLDER, deck, mesh_of, scene_of
from hexahedra import SIDES, Hexahedra, finger_facets, material_of

from sim_backend.arrays import Array

WALL_MM2 = np.pi / 2 * (2.88**2 - 2.25**2)
RING_MM3 = np.pi / 2 * 2.25**2 * (1 - 0.7**2) * 3.0
Z_MM = np.linspace(0.0, 8.0, 801)
DIPPING = (2 + np.trapezoid(np.hypot(1, np.pi / 8 * np.sin(np.pi * Z_MM / 8)), Z_MM)) / 10
"""Length of the vessel on a path, 10 - cos(pi z / 8) deep, over that of a straight one."""
VOLUMES_MM3 = {"vessel-on-a-path": (10 * DIPPING * WALL_MM2,),
               "TIHA-ball": (20 * WALL_MM2,), "cylinder-with-ends": (10 * WALL_MM2,),
               "part-length-stenosis": (10 * WALL_MM2, RING_MM3),
               "ball-over-ball": (np.pi / 3 * 3.0**3,)}  # fmt: skip
"""Of a quarter: the wall or the lump, the stenosis."""


def enclosed_mm3(mesh: Hexahedra) -> Array:
    """By the divergence theorem: each face is eight triangles about its middle."""
    found = np.zeros(len(mesh.cells))
    middles = {frozenset(pair): 8 + n for n, pair in enumerate(
        [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6),
         (3, 7)])}  # fmt: skip
    for side in SIDES.tolist():
        loop = []
        for a, b in zip(side, [*side[1:], side[0]], strict=True):
            loop += [a, middles[frozenset((a, b))]]
        rim = mesh.nodes[mesh.cells[:, loop]]
        hub = (2 * rim[:, 1::2].sum(axis=1) - rim[:, ::2].sum(axis=1)) / 4  # serendipity's middle
        for a, b in zip(range(8), [*range(1, 8), 0], strict=True):
            found += np.einsum("mi,mi->m", hub, np.cross(rim[:, b], rim[:, a])) / 6
    return found


@pytest.mark.parametrize("name", CASES)
def test_inclusions_have_their_volumes_and_the_block_is_whole(name: str) -> None:
    scene, mesh = scene_of(name), mesh_of(name)
    volume, material = enclosed_mm3(mesh), material_of(scene, mesh.middle)
    assert volume.min() > 0.0
    for number, expected in enumerate(VOLUMES_MM3[name], start=1):
        found = volume[material == number].sum()
        assert found == pytest.approx(expected, rel=0.01)  # of flat triangles
    width, length = (CASES[name].tissue[key] / 2 for key in ("width_mm", "length_mm"))
    lumen = 0.0 if name == "ball-over-ball" else np.pi / 2 * 2.25**2 * length
    lumen *= DIPPING if name == "vessel-on-a-path" else 1.0
    ring = VOLUMES_MM3[name][1] if len(VOLUMES_MM3[name]) > 1 else 0.0
    bent = 3e-4 if name == "vessel-on-a-path" else 1e-4  # of planes between which it is straight
    assert volume.sum() == pytest.approx(width * 16.83 * length - lumen + ring, rel=bent)


@pytest.mark.parametrize("name", CASES)
def test_the_finger_just_touches_and_faces_outwards(name: str) -> None:
    points, cells = finger_facets(scene_of(name).indenter, 16.83)
    assert points[:, 1].min() == pytest.approx(16.83, abs=1e-9)
    a, b, c, d = (points[cells[:, k]] for k in (0, 1, 3, 4))
    normal = np.cross(b - a, c - a)
    assert (np.einsum("mi,mi->m", normal, d - a) > 0).all()  # from S1 into the cell


@pytest.mark.parametrize("name", CASES)
def test_the_kept_deck_is_of_the_scene_beside_it(name: str) -> None:
    path = FOLDER / f"{name}.inp.xz"
    with lzma.open(path, "rt") as file:
        kept = file.read().splitlines()
    made = list(deck(name))
    ends = kept.index("*STEP, NLGEOM, INC=1000"), made.index("*STEP, NLGEOM, INC=1000")
    assert ends[0] == ends[1]
    differ = [pair for pair in zip(kept[: ends[0]], made, strict=False) if pair[0] != pair[1]]
    for ours, theirs in differ:  # rounded elsewhere
        numbers = [np.array([float(v) for v in line.split(",") if v]) for line in (ours, theirs)]
        np.testing.assert_allclose(*numbers, rtol=1e-8, atol=2e-6)
    solved = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    each = 2 if "force_before_hold_n" in solved else 1  # a load is held for one step more
    assert kept.count("*END STEP") == each * len(CASES[name].pressures_mmhg)
