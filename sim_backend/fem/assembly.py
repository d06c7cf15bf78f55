"""Element blocks into one sparse matrix whose pattern and ordering are found once."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from sim_backend.arrays import Array, Blocks, Ints
from sim_backend.fem import kernel


class SingularMatrix(RuntimeError):
    """A pivot is zero or not a number."""


class Solver(Protocol):
    """Factors of sums of groups of element matrices."""

    def factor(self, matrices: tuple[Array, ...], /) -> int:
        """How many pivots are negative; -1 if one is zero or no number."""
        ...

    def solve(self, force: Array, x: Array, /) -> None:
        """Displacements ``x`` (size,) under a ``force`` (size,); fixed ones stay."""
        ...


class Assembly:
    """Sums blocks into the matrix of the free displacements and factorises it.

    ``blocks`` are groups of element displacement numbers (m, d); every group brings matrices
    (m, d, d) to `factor`, which are symmetric but for those of the groups numbered
    ``unsymmetric``. ``fixed`` displacements are zero.
    """

    def __init__(
        self, size: int, blocks: list[Ints], fixed: Ints, unsymmetric: Collection[int] = ()
    ) -> None:
        self.size = size
        self.free = np.setdiff1d(np.arange(size), fixed)
        self._blocks = tuple(np.ascontiguousarray(dofs) for dofs in blocks)
        self._symmetric = tuple(n not in unsymmetric for n in range(len(blocks)))

    @cached_property
    def _solver(self) -> Solver:
        if kernel.BUILT:
            return kernel.Fronts(self.size, self._blocks, self._symmetric, self.free)
        from sim_backend.fem.sparse_lu import SparseLU

        return SparseLU(self.size, self._blocks, self.free)

    def __getstate__(self) -> dict[str, Any]:
        """Without the factors, which are the solver's own and cannot be kept."""
        return {name: value for name, value in self.__dict__.items() if name != "_solver"}

    def factor(self, matrices: Sequence[Blocks]) -> "Factors":
        """Factors of the summed blocks, one (m, d, d) array per group, in the groups' order.

        They hold until the next call. Raises `SingularMatrix`.
        """
        negative = self._solver.factor(
            tuple(np.ascontiguousarray(m, dtype=np.float64) for m in matrices)
        )
        if negative < 0:
            raise SingularMatrix("a pivot is zero or not a number")
        return Factors(negative, self._solver)

    def times(self, matrices: Sequence[Blocks], u: Array) -> Array:
        """The summed blocks times displacements ``u`` (size,)."""
        return sum(
            (
                gather(self.size, dofs, (m @ u[dofs][..., None])[..., 0])
                for dofs, m in zip(self._blocks, matrices, strict=True)
            ),
            np.zeros(self.size),
        )


@dataclass(frozen=True)
class Factors:
    """``negative`` counts the negative pivots: without row exchanges, as many as the symmetric
    matrix has negative eigenvalues. Where lumen pressure acts on a thinning section, the symmetric
    part says little: it has an eigenvalue of -17 beside the matrix' own 13."""

    negative: int
    _solver: Solver

    def solve(self, force: Array) -> Array:
        """Displacements (size,) or (size, r) under ``force`` of the same shape; 0 where fixed."""
        if force.ndim == 2:
            return np.stack([self.solve(one) for one in force.T], axis=1)
        found = np.zeros(len(force))
        self._solver.solve(np.ascontiguousarray(force), found)
        return found


def gather(size: int, dofs: Ints, forces: Array) -> Array:
    """Sum element forces (m, d) into (size,)."""
    total = np.bincount(dofs.ravel(), weights=forces.ravel(), minlength=size)
    return total.astype(np.float64, copy=False)
