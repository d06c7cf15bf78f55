"""Contact between finger and tissue: signed gaps, normals and their curvature, as pairs.

Contact is frictionless, at nodes; the multipliers are nodal forces, so nothing has to be integrated
over the partly touched side. A skin is compressed by its pressure times ``skin_m_per_pa``; a bonded
finger holds what it has touched.
Which pairs touch, and with what force, is found with the displacements in `sim_backend.fem.newton`.
"""

from dataclasses import dataclass, replace

import numpy as np

from sim_backend.arrays import Array, Bools, Ints
from sim_backend.fem.contact.pairs import ContactPairs, rigid_pairs
from sim_backend.scene.indenter import Indenter
from sim_backend.scene.indenter.profile import Profile


@dataclass(frozen=True)
class Finger:
    """Its outline, with the lowest point at (``x``, ``y``) [m].

    ``bonded``: what it touches sticks to it. ``skin_m`` is the skin's thickness, 0 without one.
    """

    profile: Profile
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
        gap, normal, curvature = self.profile.gap(np.abs(across), points[:, 1] - self.y)
        normal[:, 0] *= np.sign(across)
        return gap, normal, curvature


def finger_over(indenter: Indenter, x_m: float, surface_m: float) -> Finger:
    """The scene's finger just touching the undeformed surface at ``x_m``."""
    return Finger(indenter.profile, x_m, surface_m, indenter.bonded, *skin_of(indenter))


def skin_of(indenter: Indenter) -> tuple[float, float]:
    """Thickness of a finger's skin [m] and how far it gives way per pressure [m/Pa]; 0 without."""
    skin = indenter.skin
    return (1e-3 * skin.thickness_mm, skin.m_per_pa) if skin else (0.0, 0.0)


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
