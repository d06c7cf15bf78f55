"""Presses into solids by CalculiX, on hexahedra of their own, kept with their decks.

    python benchmarks/calculix_solids.py NAME [ours]

Writes the deck of one of `CASES`, runs ``ccx`` on it and keeps deck and forces in
`tests/data/presses`, which tests hold `palpate press` against. With ``ours`` it is pressed by
`sim_backend` too, in the same run, and the ratio of seconds of processor is printed. C3D20R,
finite strain, neo-Hooke, frictionless contact of faces (penalty), pressure that follows the wall;
a quarter of the block. A run takes one to five minutes of processor.

CalculiX finds the facet of the finger opposite to each point of the skin when an increment begins
and keeps it until the increment ends ("due to the freezing of the match between the slave and
master surface within each increment, large deformations may require small increments": its manual,
face-to-face penalty contact). The skin slides meanwhile. Each load is therefore held for one more
step, whose one increment finds the pairs anew; what that changes is kept beside the forces. It is
not enough after a press that begins with pressure: under a cylinder with ends that leaves the force
0.3 % above what it is by way of 0 mmHg, and the pulse 4 % too small.
"""

import json
import lzma
import re
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from hexahedra import Hexahedra, finger_facets, material_of, quarter

from sim_backend.arrays import Array, Ints
from sim_backend.models.press import press
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

FOLDER = Path(__file__).parents[1] / "tests" / "data" / "presses"
DEPTH_MM, SYMMETRIC = 2.0, 4
"""The finger's whole force is so many times the quarter's."""
TISSUE = {"width_mm": 64.0, "height_mm": 16.83, "length_mm": 40.0, "modulus_kpa": 50.0,
          "poisson": 0.49}  # fmt: skip
ARTERY = {"kind": "artery", "x_mm": 32.0, "depth_mm": 12.66, "inner_diameter_mm": 4.5,
          "wall_mm": 0.63, "modulus_kpa": 400.0, "poisson": 0.49}  # fmt: skip
BALL = {"shape": "sphere", "radius_mm": 5.0}
CYLINDER = {"shape": "cylinder", "radius_mm": 5.0, "length_mm": 10.0, "edge_radius_mm": 1.0,
            "axis": "along"}  # fmt: skip
STENOSIS = {"fraction": 0.3, "modulus_kpa": 4000.0, "z_mm": (-3.0, 3.0)}
DIP = {"path": [(z, 12.0, 10.0 - float(np.cos(np.pi * z / 8))) for z in range(-8, 9)]}
"""From 9 mm below the finger to 11 mm, leaning by up to 21 degrees."""
LUMP = {"kind": "tumour", "x_mm": 32.0, "depth_mm": 8.0, "diameter_mm": 6.0,
        "modulus_kpa": 1000.0, "poisson": 0.49}  # fmt: skip
SMALL = {**TISSUE, "width_mm": 24.0, "length_mm": 20.0}
"""A block that makes room for a finer mesh."""
EMPTY_TO_120_MMHG = (0.0, 80.0, 120.0)
LAYERS_MM = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.4, 9.0, 13.0, 20.0)
FINE_MM = (0.0, 0.75, 1.5, 2.25, 3.0, 3.75, 4.5, 5.25, 6.4, 8.0, 10.0)
"""Edges of layers over a vessel: fine below the finger, with an edge at the stenosis's end."""


class Case(NamedTuple):
    """What lies in the ``tissue`` and what presses it at ``pressures_mmhg``; hexahedra to 45
    degrees around the inclusion, and edges of their layers."""

    tissue: dict[str, Any]
    inclusion: dict[str, Any]
    finger: dict[str, Any]
    pressures_mmhg: tuple[float, ...]
    cells_45: int = 3
    z_edges_mm: tuple[float, ...] = LAYERS_MM


CASES = {
    "TIHA-ball": Case(TISSUE, ARTERY, BALL, EMPTY_TO_120_MMHG),
    "cylinder-with-ends": Case(SMALL, ARTERY, CYLINDER, EMPTY_TO_120_MMHG, 4, FINE_MM),
    "ball-over-ball": Case(TISSUE, LUMP, BALL, (0.0,)),
    "part-length-stenosis": Case(SMALL, {**ARTERY, "depth_mm": 9.0, "stenosis": STENOSIS}, BALL,
                                 EMPTY_TO_120_MMHG, 4, FINE_MM),
    "vessel-on-a-path": Case(SMALL, {**ARTERY, "depth_mm": 9.0, **DIP}, BALL, EMPTY_TO_120_MMHG, 4,
                             FINE_MM),
}  # fmt: skip
LOADING, HOLDING = "0.25, 1., 1.E-5, 0.5", "1., 1., 1.E-5, 1."
"""First increment, step, smallest and largest increment of the two steps of each load."""
CONTACT_PER_MM = 300.0
"""Contact stiffness over the tissue's modulus [1/mm]: the ball sinks 0.002 mm too far of 2."""


def scene_of(name: str) -> Scene:
    case = CASES[name]
    inclusion = {**case.inclusion, "x_mm": case.tissue["width_mm"] / 2}
    raw = {"name": name, "plane": "solid", "tissue": case.tissue, "inclusion": [inclusion]}
    return Scene.model_validate(raw | {"indenter": case.finger})


def mesh_of(name: str) -> Hexahedra:
    return quarter(scene_of(name), CASES[name].cells_45, np.array(CASES[name].z_edges_mm))


def deck(name: str) -> Iterator[str]:
    """Lines of the deck: mm, N, MPa. The quarter's force on the finger goes to the .dat file."""
    scene, mesh = scene_of(name), mesh_of(name)
    points, facets = finger_facets(scene.indenter, scene.surface_mm)
    yield f"** {scene.name}, a quarter, {DEPTH_MM:g} mm deep; mm, N, MPa"
    yield "*NODE, NSET=BLOCK"
    yield from _rows(1, mesh.nodes)
    yield "*NODE, NSET=FINGER"
    yield from _rows(1 + len(mesh.nodes), points)
    yield "*ELEMENT, TYPE=C3D20R, ELSET=BLOCK"
    yield from _rows(1, 1 + mesh.cells)
    yield "*ELEMENT, TYPE=C3D8, ELSET=FINGER"
    yield from _rows(1 + len(mesh.cells), 1 + len(mesh.nodes) + facets)
    yield from _materials(scene, material_of(scene, mesh.middle))
    faces, corners = mesh.outer_faces()
    yield from _contact(scene, faces, corners, 1 + len(mesh.cells) + np.arange(len(facets)))
    yield "*BOUNDARY"
    for axis in range(3):
        on = np.flatnonzero(mesh.nodes[:, axis] < 1e-6)
        yield from (f"{n}, {axis + 1}, {axis + 1}" for n in 1 + on)
    lumen = faces[_facing_lumen(mesh, corners)]
    for pressure, increments in product(CASES[name].pressures_mmhg, (LOADING, HOLDING)):
        yield "*STEP, NLGEOM, INC=1000"
        yield "*STATIC"
        yield increments
        yield "*BOUNDARY"
        yield "FINGER, 1, 1, 0."
        yield f"FINGER, 2, 2, {-DEPTH_MM:g}"
        yield "FINGER, 3, 3, 0."
        if len(lumen):
            yield "*DLOAD"
            load = 1e-6 * PA_PER_MMHG * pressure
            yield from (f"{cell + 1}, P{side + 1}, {load:.9e}" for cell, side in lumen)
        yield "*NODE PRINT, NSET=FINGER, TOTALS=ONLY, FREQUENCY=1000"
        yield "RF"
        yield "*END STEP"


def _rows(first: int, table: Array | Ints) -> Iterator[str]:
    whole = np.issubdtype(table.dtype, np.integer)
    for n, row in enumerate(table, start=first):
        entries = [str(v) if whole else f"{v:.6f}" for v in row]
        yield f"{n}, " + ", ".join(entries[:10]) + ("," if len(entries) > 10 else "")
        if len(entries) > 10:  # a line holds no more than 16 entries
            yield ", ".join(entries[10:])


def _materials(scene: Scene, material: Ints) -> Iterator[str]:
    """W = C10 (I1bar - 3) + (J - 1)^2 / D1 with C10 = G/2 and D1 = 2/K."""
    (one,) = scene.inclusion
    assert scene.tissue is not None
    solids = [(scene.tissue.modulus_kpa, scene.tissue.poisson), (one.modulus_kpa, one.poisson)]
    if isinstance(one, Artery) and one.stenosis is not None:
        solids.append((one.stenosis.modulus_kpa, one.poisson))
    for k, (modulus_kpa, poisson) in enumerate(solids):
        yield f"*ELSET, ELSET=E{k}"
        yield from (str(n) for n in 1 + np.flatnonzero(material == k))
        yield f"*MATERIAL, NAME=M{k}"
        yield "*HYPERELASTIC, NEO HOOKE"
        modulus = 1e-3 * modulus_kpa
        shear, bulk = modulus / (2 + 2 * poisson), modulus / (3 - 6 * poisson)
        yield f"{shear / 2:.9e}, {2 / bulk:.9e}"
        yield f"*SOLID SECTION, ELSET=E{k}, MATERIAL=M{k}"
    yield "*MATERIAL, NAME=RIGID"
    yield "*ELASTIC"
    yield "1000., 0.3"
    yield "*SOLID SECTION, ELSET=FINGER, MATERIAL=RIGID"


def _contact(scene: Scene, faces: Ints, corners: Array, facets: Ints) -> Iterator[str]:
    finger = scene.indenter
    reach = (finger.width_mm_projected / 2 + 2, finger.breadth_mm_projected / 2 + 2)
    middle = corners.mean(axis=1)
    near = (corners[..., 1] > scene.surface_mm - 1e-6).all(axis=1)
    near &= (middle[:, 0] < reach[0]) & (middle[:, 2] < reach[1])
    yield "*SURFACE, NAME=SKIN, TYPE=ELEMENT"
    yield from (f"{cell + 1}, S{side + 1}" for cell, side in faces[near])
    yield "*SURFACE, NAME=FINGER, TYPE=ELEMENT"
    yield from (f"{n}, S1" for n in facets)
    yield "*SURFACE INTERACTION, NAME=SMOOTH"
    yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    assert scene.tissue is not None
    yield f"{CONTACT_PER_MM * 1e-3 * scene.tissue.modulus_kpa:.6g}"
    yield "*CONTACT PAIR, INTERACTION=SMOOTH, TYPE=SURFACE TO SURFACE"
    yield "SKIN, FINGER"


def _facing_lumen(mesh: Hexahedra, corners: Array) -> Ints:
    """Outer faces that lie in none of the quarter's six sides."""
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    flat = (np.abs(corners - low) < 1e-6).all(axis=1) | (np.abs(corners - high) < 1e-6).all(axis=1)
    return np.flatnonzero(~flat.any(axis=1))


def calculix(lines: list[str]) -> tuple[Array, float]:
    """The whole finger's force (p, 2) [N] at each pressure, after loading and after holding, and
    seconds of processor."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "press.inp").write_text("\n".join(lines) + "\n")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        ran = subprocess.run(["ccx", "-i", "press"], cwd=folder, capture_output=True, text=True,
                             check=False)  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        printed = (Path(folder) / "press.dat").read_text()
    if ran.returncode:
        raise SystemExit(f"ccx stopped:\n{ran.stdout[-3000:]}{ran.stderr[-1000:]}")
    found = re.findall(r"set FINGER and time\s+(\S+)\s+\S+\s+(\S+)", printed)
    ends = {round(float(time)): float(fy) for time, fy in found if float(time) % 1 < 1e-6}
    spent = (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime)
    forces = [-SYMMETRIC * force for _, force in sorted(ends.items())]
    return np.reshape(forces, (-1, 2)), spent


def main(name: str, ours: bool) -> None:
    scene, pressures = scene_of(name), CASES[name].pressures_mmhg
    lines = list(deck(name))
    forces, spent = calculix(lines)
    kept = {
        "made_by": "benchmarks/calculix_solids.py",
        "by": "CalculiX 2.20, C3D20R, finite strain",
        "scene": scene.model_dump(mode="json", exclude_none=True),
        "depth_mm": DEPTH_MM, "pressures_mmhg": pressures, "force_n": forces[:, 1].tolist(),
        "force_before_hold_n": forces[:, 0].tolist(),
        "unknowns": int((mesh_of(name).nodes > 1e-6).sum()), "processor_s": round(spent, 1),
    }  # fmt: skip
    FOLDER.mkdir(parents=True, exist_ok=True)
    with lzma.open(FOLDER / f"{name}.inp.xz", "wt", preset=9) as file:
        file.write("\n".join(lines) + "\n")
    (FOLDER / f"{name}.json").write_text(json.dumps(kept, indent=1) + "\n")
    print(
        f"CalculiX: {forces.tolist()} N in {spent:.0f} s of processor, {kept['unknowns']} unknowns"
    )
    if ours:
        began = process_time()
        middle_mm = scene.inclusion[0].x_mm
        pressed = press(scene, middle_mm, DEPTH_MM, pressures, accuracy_pct=5.0)
        took = process_time() - began
        print(f"{pressed.model}, {pressed.dofs} unknowns: {[s.force_n for s in pressed.states]} N, "
              f"{pressed.error_estimate_pct:.1f} % by its own estimate, in {took:.1f} s of "
              f"processor: 1/{spent / took:.1f}")  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1], "ours" in sys.argv[2:])
