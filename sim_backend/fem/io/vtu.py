"""A solved press as a VTU file, for ParaView; needs the ``mesh`` extra (meshio)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.internal import deformation
from sim_backend.fem.material import area_ratio
from sim_backend.fem.newton import Solution
from sim_backend.fem.stress import nodal_von_mises

VTK_NAME = {6: "triangle6", 4: "quad", 8: "quad8"}


def write_vtu(section: Any, states: Sequence[Solution], path: Path) -> list[Path]:
    """One file per state of a press into a `sim_backend.fem.section.Section`: FILE.vtu, or
    FILE-0.vtu, FILE-1.vtu, ... for several.

    The nodes lie where they were before the press; "Warp by Vector" with ``displacement_m``
    presses them. Cells carry their region (0 is tissue) and smallest det F.
    """
    import meshio  # the ``mesh`` extra

    cells = section.cells.nodes
    path = Path(path)
    paths = []
    for n, state in enumerate(states):
        u = state.displacement
        squeezed = area_ratio(deformation(section, u)).min(axis=1)
        mesh = meshio.Mesh(
            _flat(section.mesh.nodes),
            [(VTK_NAME[cells.shape[1]], cells)],
            point_data={
                "displacement_m": _flat(u),
                "von_mises_pa": nodal_von_mises(section, u),
            },
            cell_data={"region": [section.mesh.region], "det_f": [squeezed]},
        )
        several = len(states) > 1
        paths.append(path.with_stem(f"{path.stem}-{n}") if several else path)
        meshio.write(paths[-1], mesh, file_format="vtu")
    return paths


def _flat(rows: Array) -> Array:
    """(n, 2) -> (n, 3) with z = 0."""
    return np.column_stack([rows, np.zeros(len(rows))])
