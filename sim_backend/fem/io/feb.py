"""A press as an input file of FEBio (version 4.0), so that it can be checked in another solver.

Units are mm, N and MPa. FEBio has no plane elements: the section is one layer of 15-node wedges,
``THICKNESS_MM`` thick, whose face z = 0 keeps its plane. In plane stress the other face is free,
in plane strain it keeps its plane too. The material is uncoupled Mooney-Rivlin with c2 = 0 and the
pressure model "Abaqus", which is our energy: W = c1 (I1bar - 3) + k/2 (J - 1)^2. FEBio writes
the finger's force to FILE-force.txt, for the layer's thickness.

The names are those of the FEBio user's manual, version 4.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.io.slab import (
    MM,
    MPA,
    Strip,
    contact_mpa_per_mm,
    exported_section,
    held_average,
    material_groups,
    rigid_bodies,
    sides_on,
)
from sim_backend.fem.mesh import T6_EDGES
from sim_backend.fem.section import Section
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

THICKNESS_MM = {True: 0.05, False: 1.0}
"""By plane stress: half of the CalculiX deck's slab, since z = 0 is a plane of symmetry."""
STEPS_PER_PRESSURE = 20

Element = ElementTree.Element


def write_feb(
    scene: Scene,
    x_mm: float,
    depth_mm: float,
    pressures_mmhg: Iterable[float],
    path: Path,
    *,
    size_mm: float | None = None,
) -> Path:
    """Write the press of `sim_backend.models.press.press` for FEBio, one unit of time per pressure.

    The mesh is that of `sim_backend.fem.io.deck.write_deck`, and so is what cannot be written:
    raises `SceneError`. The walls of a lumen may not touch in it.
    """
    section = exported_section(scene, x_mm, depth_mm, size_mm)
    pressures = tuple(float(p) for p in pressures_mmhg) or (0.0,)
    path = Path(path)
    root = Element("febio_spec", version="4.0")
    root.append(
        ElementTree.Comment(f" {scene.name}, {depth_mm:g} mm at x = {x_mm:g} mm; mm N MPa ")
    )
    _add(root, "Module", type="solid")
    _control(root, len(pressures))
    slab = _Slab(section)
    bodies = _bodies(section, slab)
    _materials(_add(root, "Material"), section, bodies)
    mesh = _add(root, "Mesh")
    _mesh(mesh, section, slab, bodies)
    domains = _add(root, "MeshDomains")
    for k in range(len(material_groups(section))):
        # by displacements alone, as our own element
        _add(domains, "SolidDomain", name=f"TISSUE{k}", mat=f"M{k}", type="elastic-solid")
    for body in bodies:
        _add(domains, "SolidDomain", name=body.name, mat=body.name)
    _support(_add(root, "Boundary"), mesh, section, slab)
    _rigid(_add(root, "Rigid"), bodies, depth_mm)
    _loads(_add(root, "Loads"), mesh, section, slab)
    _contact(_add(root, "Contact"), mesh, section, slab, bodies)
    _curves(_add(root, "LoadData"), pressures)
    _output(_add(root, "Output"), path)
    ElementTree.indent(root, " ")
    ElementTree.ElementTree(root).write(path, encoding="ISO-8859-1", xml_declaration=True)
    return path


class _Slab:
    """A plane mesh as one layer of wedges: the nodes at z = 0, at the thickness, and half way
    between those at corners."""

    def __init__(self, section: Section) -> None:
        cells = section.mesh.cells
        self.thick_mm = THICKNESS_MM[section.plane_stress]
        self.count = len(section.mesh.nodes)
        corners = np.unique(cells[:, :3])
        self._half = np.zeros(self.count, dtype=np.int64)
        self._half[corners] = 2 * self.count + np.arange(len(corners))
        plane = MM * section.mesh.nodes
        z = (0.0, self.thick_mm, self.thick_mm / 2)
        layers = zip((plane, plane, plane[corners]), z, strict=True)
        self.nodes = np.vstack([np.column_stack([p, np.full(len(p), at)]) for p, at in layers])
        top = self.count + cells
        self.cells = np.hstack(
            [cells[:, :3], top[:, :3], cells[:, 3:], top[:, 3:], self._half[cells[:, :3]]]
        )

    def above(self, nodes: Ints) -> Ints:
        """Every node of the slab over plane ``nodes`` (k,)."""
        half = self._half[nodes]
        return np.concatenate([nodes, self.count + nodes, half[half > 0]])

    def sides(self, cells: Ints, sides: Sequence[tuple[int, int]]) -> list[Ints]:
        """Eight-node faces, their normals out of the body, over cells' sides in the plane."""
        found = []
        for cell, number in sides:
            a, middle, b = cells[cell, list(T6_EDGES[number])]
            up = self.count
            corners = [a, b, up + b, up + a]
            found.append(np.array([*corners, middle, self._half[b], up + middle, self._half[a]]))
        return found


class _Body:
    """A rigid strip as one layer of bricks; nodes are numbered from ``first``."""

    def __init__(self, strip: Strip, first: int, thick_mm: float) -> None:
        plane, quads = strip.mesh()
        corners = np.unique(quads[:, :4])
        number = np.zeros(len(plane), dtype=np.int64)
        number[corners] = np.arange(len(corners))
        # wider than the tissue, so that no face of it lies half beside the finger
        z = np.repeat([-thick_mm, 2 * thick_mm], len(corners))
        self.name = strip.name
        self.first = first
        self.nodes = np.column_stack([np.tile(MM * plane[corners], (2, 1)), z])
        low = first + number[quads[:, :4]]
        high = low + len(corners)
        self.cells = np.hstack([low, high])
        # towards the tissue: side 0-1 of each brick
        self.faces = np.column_stack([low[:, 0], low[:, 1], high[:, 1], high[:, 0]])


def _bodies(section: Section, slab: _Slab) -> list[_Body]:
    found: list[_Body] = []
    first = len(slab.nodes)
    for strip in rigid_bodies(section):
        found.append(_Body(strip, first, slab.thick_mm))
        first += len(found[-1].nodes)
    return found


def _add(parent: Element, tag: str, text: object = None, **attributes: object) -> Element:
    child = ElementTree.SubElement(parent, tag, {k: str(v) for k, v in attributes.items()})
    if text is not None:
        child.text = str(text)
    return child


def _each(parent: Element, values: dict[str, object]) -> None:
    for tag, value in values.items():
        _add(parent, tag, value)


def _control(root: Element, pressures: int) -> None:
    control = _add(root, "Control")
    step = 1 / STEPS_PER_PRESSURE
    _each(
        control,
        {
            "analysis": "STATIC",
            "time_steps": STEPS_PER_PRESSURE * pressures,
            "step_size": f"{step:g}",
            "plot_level": "PLOT_MUST_POINTS",
        },
    )
    stepper = _add(control, "time_stepper", type="default")
    _each(stepper, {"max_retries": 20, "opt_iter": 15, "dtmin": 1e-6})
    _add(stepper, "dtmax", f"{step:g}", lc=3)
    solver = _add(control, "solver", type="solid")
    _each(solver, {"symmetric_stiffness": "non-symmetric", "max_refs": 40})
    _add(solver, "qn_method", type="full Newton")


def _materials(parent: Element, section: Section, bodies: list[_Body]) -> None:
    number = 0
    for k, (shear, bulk, _cells) in enumerate(material_groups(section)):
        number += 1
        one = _add(parent, "material", id=number, name=f"M{k}", type="Mooney-Rivlin")
        _each(
            one,
            {"density": 1e-9, "c1": MPA * shear / 2, "c2": 0, "k": MPA * bulk,
             "pressure_model": "Abaqus"},
        )  # fmt: skip
    for body in bodies:
        number += 1
        one = _add(parent, "material", id=number, name=body.name, type="rigid body")
        _each(one, {"density": 1e-9, "center_of_mass": "0,0,0"})


def _mesh(mesh: Element, section: Section, slab: _Slab, bodies: list[_Body]) -> None:
    for name, first, rows in [("TISSUE", 0, slab.nodes)] + [
        (b.name, b.first, b.nodes) for b in bodies
    ]:
        nodes = _add(mesh, "Nodes", name=name)
        for n, row in enumerate(rows, start=1 + first):
            _add(nodes, "node", ",".join(f"{v:.12g}" for v in row), id=n)
    number = 0
    blocks = [
        (f"TISSUE{k}", "penta15", slab.cells[cells])
        for k, (_, _, cells) in enumerate(material_groups(section))
    ] + [(b.name, "hex8", b.cells) for b in bodies]
    for name, kind, rows in blocks:
        elements = _add(mesh, "Elements", type=kind, name=name)
        for row in rows:
            number += 1
            _add(elements, "elem", _numbers(row), id=number)


def _numbers(nodes: Ints | Array) -> str:
    return ",".join(str(n) for n in 1 + np.asarray(nodes))


def _node_set(mesh: Element, name: str, nodes: Ints) -> str:
    _add(mesh, "NodeSet", _numbers(nodes), name=name)
    return name


def _surface(mesh: Element, name: str, kind: str, faces: Iterable[Ints]) -> str:
    surface = _add(mesh, "Surface", name=name)
    for n, face in enumerate(faces, start=1):
        _add(surface, kind, _numbers(face), id=n)
    return name


def _support(parent: Element, mesh: Element, section: Section, slab: _Slab) -> None:
    planes = np.arange(slab.count) if section.plane_stress else np.arange(len(slab.nodes))
    fixed = {
        "x": slab.above(section.fixed[section.fixed % 2 == 0] // 2),
        "y": slab.above(section.fixed[section.fixed % 2 == 1] // 2),
        "z": planes,
    }
    for axis, nodes in fixed.items():
        if len(nodes):
            name = _node_set(mesh, f"held_{axis}", nodes)
            bc = _add(parent, "bc", name=name, type="zero displacement", node_set=name)
            _each(bc, {f"{other}_dof": int(other == axis) for other in "xyz"})
    nodes, weights = held_average(section)
    if len(nodes):
        bc = _add(parent, "bc", type="linear constraint")
        _each(bc, {"node": 1 + nodes[0], "dof": "x"})
        for node, weight in zip(nodes[1:], weights[1:], strict=True):
            child = _add(bc, "child_dof")
            _each(child, {"node": 1 + node, "dof": "x", "value": f"{-weight / weights[0]:.12g}"})


def _rigid(parent: Element, bodies: list[_Body], depth_mm: float) -> None:
    for body in bodies:
        fixed = _add(parent, "rigid_bc", name=f"{body.name}_fixed", type="rigid_fixed")
        moves = body.name == "FINGER"
        free = {"Ry_dof"} if moves else set()
        dofs = ("Rx_dof", "Ry_dof", "Rz_dof", "Ru_dof", "Rv_dof", "Rw_dof")
        _each(fixed, {"rb": body.name} | {dof: int(dof not in free) for dof in dofs})
        if moves:
            pushed = _add(parent, "rigid_bc", name="press", type="rigid_displacement")
            _each(pushed, {"rb": body.name, "dof": "y"})
            _add(pushed, "value", f"{-depth_mm:.9g}", lc=1)


def _loads(parent: Element, mesh: Element, section: Section, slab: _Slab) -> None:
    for n, cells in enumerate(section.mesh.lumens):
        faces = slab.sides(section.mesh.cells, [(int(cell), 0) for cell in cells])
        name = _surface(mesh, f"LUMEN{n}", "quad8", faces)
        load = _add(parent, "surface_load", name=name, type="pressure", surface=name)
        _add(load, "pressure", 1, lc=2)
        # on the deformed wall
        _each(load, {"linear": 0, "symmetric_stiffness": 0})


def _contact(
    parent: Element, mesh: Element, section: Section, slab: _Slab, bodies: list[_Body]
) -> None:
    touched = {
        "FINGER": section.mesh.surface,
        "SUPPORT": np.union1d(section.mesh.resting, section.mesh.bottom),
    }
    for body in bodies:
        faces = slab.sides(section.mesh.cells, sides_on(section, touched[body.name]))
        skin = _surface(mesh, f"UNDER_{body.name}", "quad8", faces)
        rigid = _surface(mesh, f"{body.name}_FACE", "quad4", body.faces)
        pair = _add(mesh, "SurfacePair", name=f"{body.name}_PAIR")
        _each(pair, {"primary": skin, "secondary": rigid})
        contact = _add(
            parent, "contact", name=body.name, type="sliding-elastic", surface_pair=pair.get("name")
        )
        _each(
            contact,
            {
                "laugon": "PENALTY",
                "penalty": f"{contact_mpa_per_mm(section):.6g}",
                "auto_penalty": 0,
                "two_pass": 0,
                "fric_coeff": 0,
                "tension": 0,
                "symmetric_stiffness": 0,
                # a press moves the surface by more than FEBio's own default of one unit
                "search_radius": f"{MM * np.ptp(section.mesh.nodes[:, 1]):.6g}",
            },
        )


def _curves(parent: Element, pressures: Sequence[float]) -> None:
    """1: the depth's share; 2: the pressure [MPa]; 3: times that FEBio must meet."""
    times = range(1 + len(pressures))
    loads_mpa = [0.0, *(MPA * PA_PER_MMHG * p for p in pressures)]
    step = 1 / STEPS_PER_PRESSURE
    curves: list[list[float]] = [[min(t, 1) for t in times], loads_mpa, [step] * len(times)]
    for number, values in enumerate(curves, start=1):
        curve = _add(parent, "load_controller", id=number, type="loadcurve")
        _each(curve, {"interpolate": "LINEAR", "extend": "CONSTANT"})
        points = _add(curve, "points")
        for time, value in zip(times, values, strict=True):
            _add(points, "pt", f"{time},{value:.12g}")


def _output(parent: Element, path: Path) -> None:
    plot = _add(parent, "plotfile", type="febio")
    for name in ("displacement", "stress", "contact pressure"):
        _add(plot, "var", type=name)
    log = _add(parent, "logfile")
    _add(log, "rigid_body_data", data="y;Fy", name="finger", file=f"{path.stem}-force.txt")
