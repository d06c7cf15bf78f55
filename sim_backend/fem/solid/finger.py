"""Rigid fingers in space: a rounded cylinder, of which ball, punch and capsule are special cases.

The finger is all points within ``edge_m`` of a core, a cylinder of ``core_radius_m`` and
``core_half_m`` along ``axis``. A ball's core is a point; a round punch's axis is upright unless it
leans.
"""

from dataclasses import dataclass, replace

import numpy as np

from sim_backend.arrays import Array
from sim_backend.scene.indenter import Cylinder, Indenter, Punch, leaning_deg

_PUNCH_HALF = 5.0
"""Half height of a punch over its diameter: its upper end never touches."""


@dataclass(frozen=True)
class SolidFinger:
    """``centre_m`` (3,) of the core, unit ``axis`` (3,)."""

    centre_m: Array
    axis: Array
    core_radius_m: float
    core_half_m: float
    edge_m: float

    def lowered_by(self, depth_m: float) -> "SolidFinger":
        return replace(self, centre_m=self.centre_m - np.array([0.0, depth_m, 0.0]))

    def gap(self, points: Array) -> tuple[Array, Array, Array]:
        """Gap (n,) [m] to ``points`` (n, 3), its gradient (n, 3) and Hessian (n, 3, 3) [1/m].

        Inside the core, deeper than any contact goes, the gap to the nearer of side and end.
        """
        off = points - self.centre_m
        along = off @ self.axis
        side = off - along[:, None] * self.axis
        rho = np.maximum(np.linalg.norm(side, axis=1), 1e-12)
        outward = side / rho[:, None]
        endward = np.sign(along)[:, None] * self.axis
        p, q = rho - self.core_radius_m, np.abs(along) - self.core_half_m
        inside = (p <= 0) & (q <= 0)
        p_out, q_out = np.maximum(p, 0.0), np.maximum(q, 0.0)
        d = np.maximum(np.hypot(p_out, q_out), 1e-12)
        by_p = np.where(inside, p >= q, p_out / d)
        by_q = np.where(inside, p < q, q_out / d)
        gap = np.where(inside, np.maximum(p, q), d) - self.edge_m
        normal = by_p[:, None] * outward + by_q[:, None] * endward
        # d(normal): the core's edge and side curve; along rho, over d where the rounding is
        across = np.eye(3) - self.axis[:, None] * self.axis - _outer(outward)
        hessian = (by_p / rho)[:, None, None] * across
        rounded = (p > 0)[:, None, None] * _outer(outward) + (q > 0)[:, None, None] * _outer(
            endward
        )
        rounding = np.where(inside, 0.0, 1 / d)[:, None, None]
        return gap, normal, hessian + rounding * (rounded - _outer(normal))


def solid_finger(indenter: Indenter, x_m: float, surface_m: float) -> SolidFinger:
    """The scene's finger whose lowest point just touches the surface, the middle of its underside
    at ``x_m``, z = 0."""
    lean = np.radians(leaning_deg(indenter))
    upright = np.array([np.sin(lean), np.cos(lean), 0.0])
    under = 0.0  # from the core's middle down to the middle of its underside
    if isinstance(indenter, Cylinder):
        edge = 1e-3 * (indenter.edge_radius_mm or 0.0)
        level = np.array([np.cos(lean), -np.sin(lean), 0.0])
        axis = level if indenter.axis == "across" else np.array([0.0, 0.0, 1.0])
        radius, half = 1e-3 * indenter.radius_mm - edge, 0.5e-3 * indenter.length_mm - edge
        under = radius
    elif isinstance(indenter, Punch):
        edge = 1e-3 * indenter.edge_radius_mm
        axis, radius = upright, 0.5e-3 * indenter.diameter_mm - edge
        under = half = _PUNCH_HALF * 1e-3 * indenter.diameter_mm
    else:
        edge, axis, radius, half = 0.5e-3 * indenter.width_mm_projected, upright, 0.0, 0.0
    lowest = edge + radius * float(np.hypot(axis[0], axis[2])) + half * abs(float(axis[1]))
    centre = np.array([x_m + (under + edge) * upright[0], surface_m + lowest, 0.0])
    return SolidFinger(centre, axis, radius, half, edge)


def _outer(v: Array) -> Array:
    return np.asarray(v[:, :, None] * v[:, None, :])
