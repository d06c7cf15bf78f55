"""Rigid fingers in space: a profile turned about an axis that stands, or lies along the finger."""

from dataclasses import dataclass, replace

import numpy as np

from sim_backend.arrays import Array
from sim_backend.scene.indenter import Indenter
from sim_backend.scene.indenter.profile import Profile


@dataclass(frozen=True)
class SolidFinger:
    """The middle of the underside at ``under_m`` (3,), whose unit normal into the finger is ``up``.

    A finger that stands turns about ``up``. One that lies turns about the unit ``axis``, at
    ``radius_m`` above the underside, and ``profile`` is its outline along that.
    """

    profile: Profile
    under_m: Array
    up: Array
    axis: Array
    radius_m: float | None

    def lowered_by(self, depth_m: float) -> "SolidFinger":
        return replace(self, under_m=self.under_m - np.array([0.0, depth_m, 0.0]))

    def gap(self, points: Array) -> tuple[Array, Array, Array]:
        """Gap (n,) [m] to ``points`` (n, 3), its gradient (n, 3) and Hessian (n, 3, 3) [1/m]."""
        off = points - self.under_m - (self.radius_m or 0.0) * self.up
        along = off @ self.axis
        side = off - along[:, None] * self.axis
        rho = np.maximum(np.linalg.norm(side, axis=1), 1e-12)
        outward = side / rho[:, None]
        if self.radius_m is None:
            gap, slope, curvature = self.profile.gap(rho, along)
            by_rho, by_along, endward = slope[:, 0], slope[:, 1], np.tile(self.axis, (len(rho), 1))
        else:
            gap, slope, curvature = self.profile.gap(np.abs(along), self.radius_m - rho)
            by_rho, by_along = -slope[:, 1], slope[:, 0]
            endward = np.sign(along)[:, None] * self.axis
        normal = by_rho[:, None] * outward + by_along[:, None] * endward
        tangent = by_along[:, None] * outward - by_rho[:, None] * endward
        round_the_axis = np.eye(3) - self.axis[:, None] * self.axis - _outer(outward)
        hessian = (by_rho / rho)[:, None, None] * round_the_axis
        return gap, normal, hessian + curvature[:, None, None] * _outer(tangent)


def solid_finger(indenter: Indenter, x_m: float, surface_m: float) -> SolidFinger:
    """The scene's finger whose lowest point just touches the surface, the middle of its underside
    at ``x_m``, z = 0."""
    lean = np.radians(indenter.leaning_deg)
    turn = np.array([[np.cos(lean), np.sin(lean), 0], [-np.sin(lean), np.cos(lean), 0], [0, 0, 1]])
    up = turn @ [0.0, 1.0, 0.0]
    lying = indenter.lies
    outline = lying.outline if lying else indenter.profile
    under_m = np.array([x_m, surface_m + outline.sinks(lean), 0.0])
    if lying is None:
        return SolidFinger(outline, under_m, up, up, None)
    return SolidFinger(outline, under_m, up, turn @ lying.axis, lying.radius)


def _outer(v: Array) -> Array:
    return np.asarray(v[:, :, None] * v[:, None, :])
