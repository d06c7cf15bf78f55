"""Pairs that may touch: finger and surface, support and vessel, the two walls of a lumen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.arrays import Array, Bools, Ints
from sim_backend.fem.assembly import gather
from sim_backend.fem.contact.bonded import BondedContact
from sim_backend.fem.contact.finger import Finger
from sim_backend.fem.contact.lumen_self_contact import wall_gaps
from sim_backend.fem.model import Section


@dataclass(frozen=True)
class ContactPairs:
    """``k`` pairs: ``gap`` (k,) [m] and its ``gradient`` (k, d) by the displacements ``dofs``,
    (k, d), or (1, d) where all pairs share them; ``turning`` (k,) [1/m] is how fast a gradient
    over one node turns as the node slides; ``compliance`` (k,) [m²/N] of a skin is how far a pair
    may interpenetrate per contact force. ``bonded`` pairs (k,) also hold in tension.
    """

    gap: Array
    gradient: Array
    dofs: Ints
    turning: Array
    compliance: Array
    bonded: Bools

    def open(self, multiplier: Array) -> Array:
        """Gaps (k,) [m] to the skin as compressed by ``multiplier``."""
        return self.gap + self.compliance * multiplier

    def active(self, multiplier: Array, complementarity: float) -> Bools:
        """Pairs (k,) in contact: multipliers outweigh gaps."""
        return (multiplier > complementarity * self.open(multiplier)) | self.bonded

    def stiffness(self, penalty: float) -> Array:
        """Stiffness (k,) of a spring of stiffness ``penalty`` behind the skin."""
        return penalty / (1 + penalty * self.compliance)

    def force(self, multiplier: Array, size: int) -> Array:
        """Force (size,) on the body when pairs bear ``multiplier`` (k,)."""
        each = multiplier[:, None] * self.gradient
        shared = len(self.dofs) != len(each)
        return gather(size, self.dofs, each.sum(axis=0, keepdims=True) if shared else each)

    def blocks(self, multiplier: Array, active: Bools, penalty: float) -> Array:
        """Tangent blocks, (k, d, d) or (1, d, d), of ``penalty`` springs and turning normals."""
        weight = np.where(active, self.stiffness(penalty), 0.0)
        if len(self.dofs) != len(self.gap):
            return np.asarray(((self.gradient.T * weight) @ self.gradient)[None])
        along = self.gradient[:, :, None] * self.gradient[:, None, :]
        across = np.eye(self.gradient.shape[1]) - along
        return np.asarray(
            weight[:, None, None] * along - (multiplier * self.turning)[:, None, None] * across
        )

    def opening(self, change: Array) -> Array:
        """How much each gap opens (k,) for a change of displacements (n, 2)."""
        moved = change.ravel()[self.dofs]
        return np.asarray((self.gradient * moved).sum(axis=1))


def contact_pairs(
    section: Section, finger: Finger, u: Array, bonds: Sequence[BondedContact] = ()
) -> list[ContactPairs]:
    """Finger, support, then the walls of lumens that may close, as in the assembly's groups.

    ``bonds`` are what the finger and what the support hold.
    """
    place = section.mesh.nodes + u
    surface, resting = section.mesh.surface, section.mesh.resting
    gap, normal, curvature = finger.gap(place[surface])
    up = np.tile([0.0, 1.0], (len(resting), 1))
    found = [_rigid(gap, normal, _dofs(surface), curvature),
             _rigid(place[resting, 1], up, _dofs(resting), np.zeros(len(resting)))]  # fmt: skip
    if finger.skin_m:
        found[0] = replace(found[0], compliance=finger.skin_m_per_pa / section.surface_share_m)
    for number, bond in enumerate(bonds):
        found[number] = replace(found[number], bonded=bond.bonded)
    for walls in section.walls if section.self_contact else ():
        gap, gradient = wall_gaps(walls, place[walls.nodes])
        found.append(_rigid(gap, gradient, walls.dofs, np.zeros(len(gap))))
    return found


def _rigid(gap: Array, gradient: Array, dofs: Ints, turning: Array) -> ContactPairs:
    return ContactPairs(
        gap, gradient, dofs, turning, np.zeros(len(gap)), np.zeros(len(gap), dtype=bool)
    )


def walls_cross(section: Section, u: Array) -> bool:
    """Whether any lumen's walls have passed through each other."""
    place = section.mesh.nodes + u
    return any(wall_gaps(w, place[w.nodes])[0].min() < 0 for w in section.walls)


def _dofs(nodes: Ints) -> Ints:
    return np.stack([2 * nodes, 2 * nodes + 1], axis=1)
