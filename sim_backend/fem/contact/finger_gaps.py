"""Contact between finger and tissue: signed gaps, normals and their curvature, as pairs.

The finger is a flat of half width ``half_flat`` whose edges are rounded by ``radius`` (a cylinder
has no flat); above the rounding its flanks rise straight. Contact is frictionless, at nodes; the
multipliers are nodal forces, so nothing has to be integrated over the partly touched side. A skin
is compressed by its pressure times ``skin_m_per_pa``; a bonded finger holds what it has touched.
Which pairs touch, and with what force, is found with the displacements in `sim_backend.fem.newton`.
"""

from dataclasses import dataclass, replace

import numpy as np

from sim_backend.arrays import Array, Bools, Ints
from sim_backend.fem.contact.pairs import ContactPairs, rigid_pairs
from sim_backend.scene.indenter import Cylinder, Indenter, Sphere


@dataclass(frozen=True)
class Finger:
    """Lowest point at (``x``, ``y``) [m]; ``bonded``: what it touches sticks to it.

    ``skin_m`` is the skin's thickness, 0 without one.
    """

    half_flat: float
    radius: float
    x: float
    y: float
    bonded: bool = False
    skin_m: float = 0.0
    skin_m_per_pa: float = 0.0

    def lowered_to(self, y: float) -> "Finger":
        return replace(self, y=y)

    def gap(self, points: Array) -> tuple[Array, Array, Array]:
        """Gap (n,) [m] to ``points`` (n, 2), normal (n, 2) out of the finger, curvature (n,) [1/m].

        The curvature is the rate at which the normal turns as a point slides along the finger.
        """
        across = points[:, 0] - self.x
        beyond = np.sign(across) * np.maximum(np.abs(across) - self.half_flat, 0.0)
        below = np.minimum(points[:, 1] - (self.y + self.radius), 0.0)
        distance = np.hypot(beyond, below)
        safe = np.maximum(distance, 1e-12)
        normal = np.stack([beyond / safe, below / safe], axis=1)
        normal[distance < 1e-12] = [0.0, -1.0]
        round_part = (np.abs(across) > self.half_flat) & (below < 0)
        flat = ~round_part & (np.abs(across) <= self.half_flat)
        gap = np.where(flat, self.y - points[:, 1], distance - self.radius)
        normal[flat] = [0.0, -1.0]
        return gap, normal, np.where(round_part, 1 / safe, 0.0)


def finger_over(indenter: Indenter, x_m: float, surface_m: float) -> Finger:
    """The scene's finger just touching the undeformed surface at ``x_m``."""
    skin = indenter.skin
    face = (1e-3 * skin.thickness_mm, skin.m_per_pa) if skin else (0.0, 0.0)
    if isinstance(indenter, Cylinder | Sphere):
        return Finger(0.0, 1e-3 * indenter.radius_mm, x_m, surface_m, indenter.bonded, *face)
    edge = 1e-3 * indenter.edge_radius_mm
    half_flat = 0.5e-3 * indenter.width_mm_projected - edge
    return Finger(half_flat, edge, x_m, surface_m, indenter.bonded, *face)


def finger_pairs(
    finger: Finger, place: Array, dofs: Ints, surface_share_m: Array, bonded: Bools | None = None
) -> ContactPairs:
    """The finger and each node of the surface at its ``place`` (k, 2) [m]; ``dofs`` (k, 2).

    ``surface_share_m`` (k,) is the length of surface that belongs to each of these nodes.
    """
    gap, normal, curvature = finger.gap(place)
    pairs = rigid_pairs(gap, normal, dofs, curvature, bonded)
    if finger.skin_m:
        return replace(pairs, compliance=finger.skin_m_per_pa / surface_share_m)
    return pairs
