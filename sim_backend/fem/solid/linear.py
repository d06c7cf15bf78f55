"""Sparse tangents of solids: one pattern, single-precision factors now and then, Krylov always.

Factors of an earlier tangent, in single precision, precondition GMRES (Saad and Schultz 1986) on
the present one in double precision. New factors are made where that takes too long.
"""

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import LinearOperator, SuperLU, gmres, splu

from sim_backend.arrays import Array, Ints

RELATIVE = 1e-5
"""How far a Newton step's residual falls: its own error is squared anyway."""
MOST_STEPS, SLOW_STEPS = 30, 15
"""Krylov steps after which new factors are made at once, and for the next Newton step."""
_OPTIONS = {"SymmetricMode": True}


class Singular(Exception):
    """The tangent has no inverse."""


class LinearSolver:
    """Solves for the free displacements of ``groups`` of element displacement numbers (m, d).

    ``order`` (f,) are the free numbers in the order of elimination. ``leaning`` are (stiffness,
    weights (size,)) of averages that are held: dense, so that factors see ``propped`` instead.
    """

    def __init__(
        self, size: int, groups: list[Ints], order: Ints, leaning: list[tuple[float, Array]]
    ) -> None:
        self.size, self.order = size, order
        n = len(order)
        number = np.full(size, -1, dtype=np.int64)
        number[order] = np.arange(n)
        keys = []
        for dofs in groups:
            local = number[dofs]
            key = local[:, None, :] * n + local[:, :, None]
            key[(local < 0)[:, None, :] | (local < 0)[:, :, None]] = -1
            keys.append(key.ravel())
        key = np.concatenate(keys)
        unique, index = np.unique(key, return_inverse=True)
        first = int(unique[0] < 0)
        unique = unique[first:]
        index = index.ravel() - first
        index[index < 0] = len(unique)
        self._index = index.astype(np.int32)
        self._rows = (unique % n).astype(np.int32)
        self._starts = np.searchsorted(unique // n, np.arange(n + 1)).astype(np.int32)
        self._diagonal = np.flatnonzero(unique % n == unique // n)
        self._leaning = [(s, w[order]) for s, w in leaning]
        self._factors: SuperLU | None = None
        self.factorisations = self.steps = 0

    def matrix(self, blocks: list[Array]) -> csc_matrix:
        """The free tangent, without what leans, from one (m, d, d) array per group."""
        data = np.concatenate([b.ravel() for b in blocks])
        count = len(self._rows)
        values = np.bincount(self._index, weights=data, minlength=count + 1)[:count]
        n = len(self.order)
        return csc_matrix((values, self._rows, self._starts), shape=(n, n))

    def solve(self, matrix: csc_matrix, force: Array) -> Array:
        """Displacements (size,) under ``force`` (size,). Raises `Singular`."""
        right = force[self.order]
        result = np.zeros(self.size)
        if not np.any(right):
            return result
        if self._factors is None:
            self._factor(matrix)
        x, taken = self._krylov(matrix, right, MOST_STEPS)
        if x is None:
            self._factor(matrix)
            x, taken = self._krylov(matrix, right, 4 * MOST_STEPS)
        if x is None:
            raise Singular
        if taken > SLOW_STEPS:
            self._factors = None
        result[self.order] = x
        return result

    def _factor(self, matrix: csc_matrix) -> None:
        propped = matrix.astype(np.float32)
        for stiffness, weight in self._leaning:
            propped.data[self._diagonal] += np.float32(stiffness) * (weight**2).astype(np.float32)
        self.factorisations += 1
        try:
            self._factors = splu(
                propped, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=_OPTIONS
            )
        except RuntimeError:
            raise Singular from None

    def _krylov(self, matrix: csc_matrix, right: Array, most: int) -> tuple[Array | None, int]:
        factors = self._factors
        assert factors is not None
        n = len(right)
        counted = 0

        def apply(x: Array) -> Array:
            y = matrix @ x
            for stiffness, weight in self._leaning:
                y = y + stiffness * float(weight @ x) * weight
            return np.asarray(y)

        def count(_: float) -> None:
            nonlocal counted
            counted += 1

        inverse = LinearOperator(
            (n, n), matvec=lambda x: factors.solve(x.astype(np.float32)).astype(np.float64)
        )
        x, failed = gmres(
            LinearOperator((n, n), matvec=apply), right, rtol=RELATIVE, restart=most, maxiter=1,
            M=inverse, callback=count, callback_type="pr_norm",
        )  # fmt: skip
        self.steps += counted
        # where restarts end without the tolerance, a residual twice as small would still do
        good = np.all(np.isfinite(x)) and (
            not failed or np.linalg.norm(right - apply(x)) < 0.1 * np.linalg.norm(right)
        )
        return (np.asarray(x) if good else None), counted
