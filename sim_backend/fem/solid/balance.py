"""Balance of a deformed body: forces of wedges, lumens under pressure, average constraints."""

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.assembly import gather
from sim_backend.fem.solid.body import Body
from sim_backend.fem.solid.forces import forces, unit_pressure


def body_forces(body: Body, u: Array, pressure_pa: float) -> tuple[Array, list[Array]]:
    """Residual (3n,) [N] at displacements ``u`` (n, 3) [m], and the lumens' tangent blocks."""
    residual = gather(body.size, body.wedges.dofs, forces(body.wedges, body.shear, body.bulk, u))
    residual -= pressure_pa * body.thrust
    blocks = []
    for faces in body.lumens:
        unit, turning = unit_pressure(faces, body.wedges.nodes + u)
        residual -= gather(body.size, faces.dofs, pressure_pa * unit)
        blocks.append(-pressure_pa * turning)
    for stiffness, weight in body.leaning:
        residual += stiffness * float(weight @ u.ravel()) * weight
    return np.asarray(residual), blocks
