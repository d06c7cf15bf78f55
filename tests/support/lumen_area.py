"""The area that a pressure works on."""

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.lumen import Sides


def lumen_area_m2(sides: Sides, u: Array) -> float:
    """Area [m2] inside the deformed lumen."""
    place = sides.place + u[sides.nodes]
    at = np.einsum("qk,ski->sqi", sides.spread, place)
    tangent = np.einsum("qk,ski->sqi", sides.along, place)
    return float(-0.5 * (at[..., 0] * tangent[..., 1] - at[..., 1] * tangent[..., 0]).sum())
