"""Pairs that may touch: finger and surface, support and vessel, the two walls of a lumen."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_backend.fem.assembly import gather
from sim_backend.fem.collapse import wall_gaps
from sim_backend.fem.contact import Finger
from sim_backend.fem.section import Section

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Touch:
    """``k`` pairs: ``gap`` (k,) [m] and its ``gradient`` (k, d) by the displacements ``dofs``,
    (k, d), or (1, d) where all pairs share them; ``turning`` (k,) [1/m] is how fast a gradient
    over one node turns as the node slides; ``give`` (k,) [m²/N] how much a gap may be undercut per
    push, by a skin. Pairs that are ``stuck`` (k,) hold also when pulled.
    """

    gap: Array
    gradient: Array
    dofs: Ints
    turning: Array
    give: Array
    stuck: NDArray[np.bool_]

    def open(self, push: Array) -> Array:
        """Gaps (k,) [m] to the skin as it has given way to ``push``."""
        return self.gap + self.give * push

    def active(self, push: Array, judge: float) -> NDArray[np.bool_]:
        """Pairs (k,) that touch: pushes outweigh gaps."""
        return (push > judge * self.open(push)) | self.stuck

    def firmness(self, firm: float) -> Array:
        """Stiffness (k,) of a spring ``firm`` behind the skin."""
        return firm / (1 + firm * self.give)

    def force(self, push: Array, size: int) -> Array:
        """Force (size,) on the body when pairs push with ``push`` (k,)."""
        each = push[:, None] * self.gradient
        shared = len(self.dofs) != len(each)
        return gather(size, self.dofs, each.sum(axis=0, keepdims=True) if shared else each)

    def blocks(self, push: Array, active: NDArray[np.bool_], firm: float) -> Array:
        """Tangent blocks, (k, d, d) or (1, d, d), of ``firm`` springs and turning normals."""
        weight = np.where(active, self.firmness(firm), 0.0)
        if len(self.dofs) != len(self.gap):
            return np.asarray(((self.gradient.T * weight) @ self.gradient)[None])
        along = self.gradient[:, :, None] * self.gradient[:, None, :]
        across = np.eye(self.gradient.shape[1]) - along
        return np.asarray(
            weight[:, None, None] * along - (push * self.turning)[:, None, None] * across
        )

    def closing(self, change: Array) -> Array:
        """How much each gap opens (k,) for a change of displacements (n, 2)."""
        moved = change.ravel()[self.dofs]
        return np.asarray((self.gradient * moved).sum(axis=1))


def touches(
    section: Section, finger: Finger, u: Array, stuck: NDArray[np.bool_] | None = None
) -> list[Touch]:
    """Finger, support, then the walls of lumens that may close, as in the assembly's groups.

    ``stuck`` are the surface's nodes that a bonded finger holds.
    """
    place = section.mesh.nodes + u
    surface, resting = section.mesh.surface, section.mesh.resting
    gap, normal, curvature = finger.gap(place[surface])
    up = np.tile([0.0, 1.0], (len(resting), 1))
    found = [_rigid(gap, normal, _dofs(surface), curvature),
             _rigid(place[resting, 1], up, _dofs(resting), np.zeros(len(resting)))]  # fmt: skip
    if finger.skin_m:
        found[0] = replace(found[0], give=finger.skin_m_per_pa / section.surface_share_m)
    if stuck is not None:
        found[0] = replace(found[0], stuck=stuck)
    for walls in section.walls if section.may_close else ():
        gap, gradient = wall_gaps(walls, place[walls.nodes])
        found.append(_rigid(gap, gradient, walls.dofs, np.zeros(len(gap))))
    return found


def _rigid(gap: Array, gradient: Array, dofs: Ints, turning: Array) -> Touch:
    return Touch(gap, gradient, dofs, turning, np.zeros(len(gap)), np.zeros(len(gap), dtype=bool))


def walls_cross(section: Section, u: Array) -> bool:
    """Whether any lumen's walls have passed through each other."""
    place = section.mesh.nodes + u
    return any(wall_gaps(w, place[w.nodes])[0].min() < 0 for w in section.walls)


def _dofs(nodes: Ints) -> Ints:
    return np.stack([2 * nodes, 2 * nodes + 1], axis=1)
