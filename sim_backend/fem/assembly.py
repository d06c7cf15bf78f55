"""Element blocks into one sparse matrix whose pattern and ordering are found once."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_OPTIONS = {"SymmetricMode": True}


class Assembly:
    """Sums blocks into the matrix of the free displacements and factorises it.

    ``blocks`` are groups of element displacement numbers (m, d); every group may bring matrices
    (m, d, d) to `factor`. ``fixed`` displacements are held.
    """

    def __init__(self, size: int, blocks: list[Ints], fixed: Ints) -> None:
        self.size = size
        self.free = np.setdiff1d(np.arange(size), fixed)
        number = np.full(size, -1)
        number[self.free] = np.arange(len(self.free))
        rows, columns = [], []
        for dofs in blocks:
            local = number[dofs]
            rows.append(np.repeat(local, local.shape[1], axis=1).ravel())
            columns.append(np.tile(local, (1, local.shape[1])).ravel())
        row, column = np.concatenate(rows), np.concatenate(columns)
        order = _elimination_order(len(self.free), row, column)
        self._order = order
        place = np.argsort(order)
        kept = (row >= 0) & (column >= 0)
        key = place[column[kept]] * len(self.free) + place[row[kept]]
        unique, index = np.unique(key, return_inverse=True)
        n = len(self.free)
        self._pattern = (
            (unique % n).astype(np.int32),
            np.searchsorted(unique // n, np.arange(n + 1)).astype(np.int32),
        )
        self._index = np.full(len(row), len(unique))
        self._index[kept] = index.ravel()

    def factor(self, matrices: list[Array]) -> SuperLU:
        """Factors of the summed blocks, one (m, d, d) array per group, in the groups' order."""
        data = np.concatenate([m.ravel() for m in matrices])
        count = len(self._pattern[0])
        values = np.bincount(self._index, weights=data, minlength=count + 1)[:count]
        n = len(self.free)
        matrix = csc_matrix((values, *self._pattern), shape=(n, n))
        return splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=_OPTIONS)

    def solve(self, factors: SuperLU, force: Array) -> Array:
        """Displacements (size,) or (size, r) under ``force`` of the same shape; 0 where held."""
        result = np.zeros_like(force)
        result[self.free[self._order]] = factors.solve(
            np.ascontiguousarray(force[self.free[self._order]])
        )
        return result


def gather(size: int, dofs: Ints, forces: Array) -> Array:
    """Sum element forces (m, d) into (size,)."""
    total = np.bincount(dofs.ravel(), weights=forces.ravel(), minlength=size)
    return total.astype(np.float64, copy=False)


def _elimination_order(n: int, row: Ints, column: Ints) -> Ints:
    """The free unknowns in minimum-degree order, found by factoring a matrix of this pattern."""
    kept = (row >= 0) & (column >= 0)
    pattern = csc_matrix((-np.ones(kept.sum()), (row[kept], column[kept])), shape=(n, n))
    pattern.setdiag(-2 * np.asarray(pattern.sum(axis=0)).ravel())  # safely away from singular
    factors = splu(
        pattern.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options=_OPTIONS,
    )
    return np.argsort(factors.perm_c).astype(np.int64)
