"""A press as an Abaqus or CalculiX deck, so that it can be checked in another solver.

Units are mm, N and MPa. Run with ``ccx -i FILE`` (without the suffix); the finger's force is
printed to FILE.dat after each step, for the thickness that the deck's heading names.

CalculiX makes a slab of finite thickness out of plane elements, and a slab resists thinning
unevenly: a slab of a lone vessel 1 mm thick is 12 % stiffer than in plane stress, and a vessel in
tissue 0.6 %. A thin slab goes to the limit.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.io.slab import (
    MM,
    MPA,
    contact_mpa_per_mm,
    exported_section,
    held_average,
    material_groups,
    rigid_bodies,
    sides_on,
)
from sim_backend.fem.section import Section
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

THICKNESS_MM = {"CPS6": 0.1, "CPE6": 1.0}


def write_deck(
    scene: Scene,
    x_mm: float,
    depth_mm: float,
    pressures_mmhg: Iterable[float],
    path: Path,
    *,
    size_mm: float | None = None,
) -> Path:
    """Write the press of `sim_backend.models.press.press` as a deck of one step per pressure.

    Six-node triangles on the mesh of our own solver; ``size_mm`` is its element size at the
    finger. The walls of a lumen may not touch in it. Raises `SceneError` as `press` does.
    """
    section = exported_section(scene, x_mm, depth_mm, size_mm)
    pressures = tuple(float(p) for p in pressures_mmhg) or (0.0,)
    path = Path(path)
    path.write_text("\n".join(_deck(scene, section, depth_mm, pressures)) + "\n")
    return path


def ccx_forces_n_per_mm(deck: Path) -> list[float]:
    """The finger's force [N/mm] at the end of each step that CalculiX finished on ``deck``."""
    thickness = re.search(r"(\S+) mm thick", deck.read_text())
    assert thickness is not None, "write_deck names the thickness"
    block = re.compile(
        r"total force \(fx,fy,fz\) for set FINGER and time\s+(\S+)\s+\S+\s+(\S+)", re.IGNORECASE
    )
    found = block.findall(deck.with_suffix(".dat").read_text())
    at = {float(time): -float(fy) / float(thickness[1]) for time, fy in found}
    return [force for time, force in sorted(at.items()) if abs(time - round(time)) < 1e-6]


def _deck(
    scene: Scene, section: Section, depth_mm: float, pressures: Sequence[float]
) -> Iterator[str]:
    mesh, kind = section.mesh, "CPS6" if section.plane_stress else "CPE6"
    yield f"** {scene.name}, {depth_mm:g} mm deep at x = {MM * section.finger.x:g} mm"
    thick = f"{THICKNESS_MM[kind]:g}"
    yield f"** mm, N, MPa; {thick} mm thick. The finger's force stands in the .dat file."
    bodies = rigid_bodies(section)
    yield "*NODE, NSET=TISSUE"
    yield from _table(1 + np.arange(len(mesh.nodes)), MM * mesh.nodes)
    yield f"*ELEMENT, TYPE={kind}, ELSET=TISSUE"
    yield from _table(1 + np.arange(len(mesh.cells)), 1 + mesh.cells)
    node, element = len(mesh.nodes), len(mesh.cells)
    for body in bodies:
        nodes, cells = body.mesh()
        yield f"*NODE, NSET={body.name}"
        yield from _table(1 + node + np.arange(len(nodes)), MM * nodes)
        yield f"*ELEMENT, TYPE={kind[:3]}8, ELSET={body.name}"
        numbers = 1 + element + np.arange(len(cells))
        yield from _table(numbers, 1 + node + cells)
        yield f"*SURFACE, NAME={body.name}, TYPE=ELEMENT"
        yield from (f"{n}, S1" for n in numbers)
        node, element = node + len(nodes), element + len(cells)
    yield from _materials(section, [body.name for body in bodies], thick)
    yield from _contact(section, bool(len(mesh.resting)))
    yield from _support(section)
    yield from _steps(section, depth_mm, pressures)


def _table(numbers: Ints, rows: Array | Ints) -> Iterator[str]:
    whole = np.issubdtype(rows.dtype, np.integer)
    for n, row in zip(numbers, rows, strict=True):
        yield f"{n}, " + ", ".join(str(v) if whole else f"{v:.9f}" for v in row)


def _materials(section: Section, rigid: list[str], thick: str) -> Iterator[str]:
    """W = C10 (I1bar - 3) + (J - 1)^2 / D1 with C10 = G/2 and D1 = 2/K."""
    for k, (shear, bulk, cells) in enumerate(material_groups(section)):
        yield f"*ELSET, ELSET=E{k}"
        yield from (str(n) for n in 1 + cells)
        yield f"*MATERIAL, NAME=M{k}"
        yield "*HYPERELASTIC, NEO HOOKE"
        yield f"{MPA * shear / 2:.9e}, {2 / (MPA * bulk):.9e}"
        yield f"*SOLID SECTION, ELSET=E{k}, MATERIAL=M{k}"
        yield thick
    yield "*MATERIAL, NAME=RIGID"
    yield "*ELASTIC"
    yield "1000., 0.3"
    for name in rigid:
        yield f"*SOLID SECTION, ELSET={name}, MATERIAL=RIGID"
        yield thick


def _contact(section: Section, rests: bool) -> Iterator[str]:
    yield "*SURFACE, NAME=SKIN, TYPE=ELEMENT"
    yield from _faces(section, section.mesh.surface)
    yield "*SURFACE INTERACTION, NAME=SMOOTH"
    yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    yield f"{contact_mpa_per_mm(section):.6g}"
    yield "*CONTACT PAIR, INTERACTION=SMOOTH, TYPE=SURFACE TO SURFACE"
    yield "SKIN, FINGER"
    if rests:
        yield "*SURFACE, NAME=BELLY, TYPE=ELEMENT"
        yield from _faces(section, np.union1d(section.mesh.resting, section.mesh.bottom))
        yield "*CONTACT PAIR, INTERACTION=SMOOTH, TYPE=SURFACE TO SURFACE"
        yield "BELLY, SUPPORT"


def _faces(section: Section, chosen: Ints) -> Iterator[str]:
    for cell, side in sides_on(section, chosen):
        yield f"{cell + 1}, S{side + 1}"


def _support(section: Section) -> Iterator[str]:
    nodes, weights = held_average(section)
    if len(nodes):
        # on average they do not slide: the heaviest is eliminated
        yield "*EQUATION"
        yield str(len(nodes))
        yield from (f"{n}, 1, {w:.9e}" for n, w in zip(1 + nodes, weights, strict=True))
    yield "*BOUNDARY"
    yield from (f"{d // 2 + 1}, {d % 2 + 1}, {d % 2 + 1}, 0." for d in section.fixed)
    if len(section.mesh.resting):
        yield "SUPPORT, 1, 2, 0."


def _steps(section: Section, depth_mm: float, pressures: Sequence[float]) -> Iterator[str]:
    for pressure in pressures:
        yield "*STEP, NLGEOM, INC=1000"
        yield "*STATIC"
        yield "0.02, 1., 1.E-6, 0.05"
        yield "*BOUNDARY"
        yield "FINGER, 1, 1, 0."
        yield f"FINGER, 2, 2, {-depth_mm:.9g}"
        if section.lumens:
            yield "*DLOAD"
            load = MPA * PA_PER_MMHG * pressure
            for cells in section.mesh.lumens:
                yield from (f"{n + 1}, P1, {load:.9e}" for n in cells)
        yield "*NODE PRINT, NSET=FINGER, TOTALS=ONLY, FREQUENCY=1000"
        yield "RF"
        yield "*NODE FILE, FREQUENCY=1000"
        yield "U"
        yield "*EL FILE, FREQUENCY=1000"
        yield "S"
        yield "*END STEP"
