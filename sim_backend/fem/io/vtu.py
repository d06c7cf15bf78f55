"""A solved press as a VTU file, for ParaView; needs the ``mesh`` extra (meshio)."""

from collections.abc import Sequence
from functools import singledispatch
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.internal import deformation
from sim_backend.fem.material import area_ratio
from sim_backend.fem.newton import Solution
from sim_backend.fem.section import Section
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.forces import volume_ratios
from sim_backend.fem.solid.stress import von_mises_at_nodes
from sim_backend.fem.stress import nodal_von_mises

VTK_NAME = {6: "triangle6", 4: "quad", 8: "quad8", 18: "wedge18"}
VTK_WEDGE = [0, 1, 2, 12, 13, 14, 3, 4, 5, 15, 16, 17, 6, 7, 8, 9, 10, 11]
"""Our wedges are numbered plane by plane; VTK's have the corners first, then the middles of the
triangles' sides, of the edges between them, and of the faces."""


class _Fields(NamedTuple):
    """Nodes (n, d), ``cells`` (m, k) in VTK's order and the ``region`` (m,) of each; von Mises
    stress (n,) [Pa] and the smallest det F (m,)."""

    nodes: Array
    cells: Ints
    region: Ints
    von_mises_pa: Array
    det_f: Array


@singledispatch
def _fields(body: Any, u: Array) -> _Fields:
    """Of a body and the displacements of its nodes."""
    raise NotImplementedError(type(body))


@_fields.register
def _(body: Section, u: Array) -> _Fields:
    squeezed = area_ratio(deformation(body, u)).min(axis=1)
    mesh = body.mesh
    return _Fields(mesh.nodes, body.cells.nodes, mesh.region, nodal_von_mises(body, u), squeezed)


@_fields.register
def _(body: SolidBody, u: Array) -> _Fields:
    cells = body.wedges.cells
    at_nodes = von_mises_at_nodes(body, u, np.arange(len(cells))).ravel()
    stress = np.bincount(cells.ravel(), at_nodes) / np.bincount(cells.ravel()).clip(1)
    squeezed = volume_ratios(body.wedges, u)
    return _Fields(body.wedges.nodes, cells[:, VTK_WEDGE], body.region, stress, squeezed)


def write_vtu(body: Any, states: Sequence[Solution], path: Path) -> list[Path]:
    """One file per state of a press into a section or a solid: FILE.vtu, or FILE-0.vtu,
    FILE-1.vtu, ... for several.

    The nodes lie where they were before the press; "Warp by Vector" with ``displacement_m``
    presses them. Cells carry their region (0 is tissue) and smallest det F.
    """
    import meshio  # the ``mesh`` extra

    path = Path(path)
    paths = []
    for n, state in enumerate(states):
        u = state.displacement
        fields = _fields(body, u)
        mesh = meshio.Mesh(
            _in_space(fields.nodes),
            [(VTK_NAME[fields.cells.shape[1]], fields.cells)],
            point_data={"displacement_m": _in_space(u), "von_mises_pa": fields.von_mises_pa},
            cell_data={"region": [fields.region], "det_f": [fields.det_f]},
        )
        several = len(states) > 1
        paths.append(path.with_stem(f"{path.stem}-{n}") if several else path)
        meshio.write(paths[-1], mesh, file_format="vtu")
    return paths


def _in_space(rows: Array) -> Array:
    """(n, 2) -> (n, 3) with z = 0; (n, 3) as it is."""
    return np.pad(rows, ((0, 0), (0, 3 - rows.shape[1])))
