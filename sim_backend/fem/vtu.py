"""A solved press as a VTU file, for ParaView; needs the ``mesh`` extra (meshio)."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim_backend.fem.internal import deformation
from sim_backend.fem.material import area_ratio

if TYPE_CHECKING:
    from sim_backend.press import Press

Array = NDArray[np.float64]

VTK_NAME = {6: "triangle6", 4: "quad", 8: "quad8"}


def write_vtu(press: "Press", path: Path) -> list[Path]:
    """One file per state: FILE.vtu, or FILE-0.vtu, FILE-1.vtu, ... where there are several.

    The nodes lie where they were before the press; "Warp by Vector" with ``displacement_m``
    presses them. Cells carry their region (0 is tissue) and smallest det F. Raises ImportError,
    saying what to install, without meshio.
    """
    try:
        import meshio
    except ImportError:
        raise ImportError(
            "VTU files are written by meshio, which is not installed: pip install 'palpate[mesh]'"
        ) from None
    section = press.mesh.section
    cells = section.cells.nodes
    path = Path(path)
    paths = []
    for n, state in enumerate(press.states):
        u = state.displacement_m
        squeezed = area_ratio(deformation(section, u)).min(axis=1)
        mesh = meshio.Mesh(
            _flat(section.mesh.nodes),
            [(VTK_NAME[cells.shape[1]], cells)],
            point_data={
                "displacement_m": _flat(u),
                "von_mises_pa": press.mesh.von_mises(state),
            },
            cell_data={"region": [section.mesh.region], "det_f": [squeezed]},
        )
        several = len(press.states) > 1
        paths.append(path.with_stem(f"{path.stem}-{n}") if several else path)
        meshio.write(paths[-1], mesh, file_format="vtu")
    return paths


def _flat(rows: Array) -> Array:
    """(n, 2) -> (n, 3) with z = 0."""
    return np.column_stack([rows, np.zeros(len(rows))])
