"""Pairs that may touch, whoever they are: gaps, gradients, forces and tangents."""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array, Bools, Ints


@dataclass(frozen=True)
class ContactPairs:
    """``k`` pairs: ``gap`` (k,) [m] and its ``gradient`` (k, d) by the displacements ``dofs``,
    (k, d), or (1, d) where all pairs share them; ``turning`` (k,) [1/m] is how fast a gradient
    over one node turns as the node slides; ``compliance`` (k,) [m²/N] of a skin is how far a pair
    may interpenetrate per contact force. ``bonded`` pairs (k,) also hold in tension. ``hessian``
    (k, d, d) [1/m] of the gaps is known where nodes can slide two ways.
    """

    gap: Array
    gradient: Array
    dofs: Ints
    turning: Array
    compliance: Array
    bonded: Bools
    hessian: Array | None = None

    def open(self, multiplier: Array) -> Array:
        """Gaps (k,) [m] to the skin as compressed by ``multiplier``."""
        return self.gap + self.compliance * multiplier

    def active(self, multiplier: Array, complementarity: float) -> Bools:
        """Pairs (k,) in contact: multipliers outweigh gaps."""
        return (multiplier > complementarity * self.open(multiplier)) | self.bonded

    def stiffness(self, penalty: float) -> Array:
        """Stiffness (k,) of a spring of stiffness ``penalty`` behind the skin."""
        return penalty / (1 + penalty * self.compliance)

    def add_force(self, multiplier: Array, total: Array) -> None:
        """Add to ``total`` (size,) the force on the body when pairs carry ``multiplier`` (k,)."""
        shared = len(self.dofs) != len(self.gap)
        each = multiplier @ self.gradient if shared else multiplier[:, None] * self.gradient
        total[self.dofs] += each  # no two pairs have a node in common, unless they share all

    def springs(self, active: Bools, penalty: float) -> Array:
        """Tangent blocks, (k, d, d) or (1, d, d), of ``penalty`` springs."""
        weight = np.where(active, self.stiffness(penalty), 0.0)
        if len(self.dofs) != len(self.gap):
            return np.asarray(((self.gradient.T * weight) @ self.gradient)[None])
        return np.asarray(weight[:, None, None] * self._along)

    def turned(self, multiplier: Array) -> Array:
        """Tangent blocks, shaped as the springs', of normals that turn under ``multiplier``."""
        if len(self.dofs) != len(self.gap):
            return np.zeros((1, self.gradient.shape[1], self.gradient.shape[1]))
        if self.hessian is not None:
            return np.asarray(-multiplier[:, None, None] * self.hessian)
        across = np.eye(self.gradient.shape[1]) - self._along
        return np.asarray(-(multiplier * self.turning)[:, None, None] * across)

    def blocks(self, multiplier: Array, active: Bools, penalty: float) -> Array:
        """Tangent blocks of springs and turning normals."""
        return np.asarray(self.springs(active, penalty) + self.turned(multiplier))

    @property
    def _along(self) -> Array:
        return np.asarray(self.gradient[:, :, None] * self.gradient[:, None, :])

    def opening(self, change: Array) -> Array:
        """How much each gap opens (k,) for a change of displacements (n, 2)."""
        moved = change.ravel()[self.dofs]
        return np.asarray((self.gradient * moved).sum(axis=1))


def rigid_pairs(
    gap: Array, gradient: Array, dofs: Ints, turning: Array | None = None,
    bonded: Bools | None = None, hessian: Array | None = None,
) -> ContactPairs:  # fmt: skip
    """Pairs whose partners do not give way; gradients do not turn, and nothing sticks, unless said
    so."""
    none = np.zeros(len(gap))
    return ContactPairs(
        gap,
        gradient,
        dofs,
        none if turning is None else turning,
        none,
        none.astype(bool) if bonded is None else bonded,
        hessian,
    )


def node_dofs(nodes: Ints, dimension: int = 2) -> Ints:
    """Degrees of freedom (n, d) of nodes (n,)."""
    return np.asarray(dimension * nodes[:, None] + np.arange(dimension))
