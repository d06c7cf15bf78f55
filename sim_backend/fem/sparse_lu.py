"""Factors by scipy's SuperLU, where the kernel was not built: five times as slow."""

from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from sim_backend.arrays import Array, Ints

_OPTIONS = {"SymmetricMode": True}


class SparseLU:
    """A `sim_backend.fem.assembly.Solver` of ``groups`` of element displacement numbers (m, d);
    all but the ``free`` displacements of ``size`` are fixed."""

    def __init__(self, size: int, groups: tuple[Ints, ...], free: Ints) -> None:
        self._free, n = free, len(free)
        number = np.full(size, -1)
        number[free] = np.arange(n)
        rows, columns = [], []
        for dofs in groups:
            local = number[dofs]
            rows.append(np.repeat(local, local.shape[1], axis=1).ravel())
            columns.append(np.tile(local, (1, local.shape[1])).ravel())
        row, column = np.concatenate(rows), np.concatenate(columns)
        self._kept = (row >= 0) & (column >= 0)
        entries, self._index = np.unique(
            column[self._kept] * n + row[self._kept], return_inverse=True
        )
        starts = np.searchsorted(entries, n * np.arange(n + 1))
        self._matrix = csc_matrix((np.zeros(len(entries)), entries % n, starts), shape=(n, n))
        self._lu: Any = None

    def factor(self, matrices: tuple[Array, ...]) -> int:
        from scipy.sparse.linalg import splu  # a tenth of the start-up

        data = np.concatenate([m.ravel() for m in matrices])[self._kept]
        sums = np.bincount(self._index, weights=data, minlength=self._matrix.nnz)
        self._matrix.data = sums.astype(np.float64, copy=False)
        if not np.isfinite(self._matrix.data).all():
            return -1
        try:
            self._lu = splu(self._matrix, "MMD_AT_PLUS_A", 0.0, options=_OPTIONS)
        except RuntimeError:
            return -1
        return int((self._lu.U.diagonal() < 0).sum())

    def solve(self, force: Array, x: Array) -> None:
        x[self._free] = self._lu.solve(force[self._free])
