"""Element blocks into one sparse matrix whose pattern and ordering are found once.

The tangent is symmetric but for the pressure on a section that thins (5.6e-5 of it), so its
symmetric part is factorised as L D L^T and the difference is made good by iterative refinement.
The signs of the pivots tell stability.
"""

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from sim_backend.arrays import Array, Ints

try:
    import qdldl
except ImportError:  # no wheel for this machine: scipy's LU gives the same, twice as slowly
    qdldl = None

_LU_OPTIONS = {"SymmetricMode": True}
CLOSE, EXACT = 1e-4, 1e-6
"""Residual of a linear solve over its right-hand side. With the first, Newton's method takes 1 %
more iterations than with exact solves (TIHA: 6.25 and 6.19 each); slopes take the second, which
moves TIHA's forces by less than 1e-8 of themselves from 1e-9."""
MAX_CORRECTIONS = 10
"""A TIHA solve takes 3.5 corrections to `CLOSE`, 6 to 8 to `EXACT`, 11 and more to 1e-9; where this
many do not do, the symmetric part says too little about the matrix, and LU takes its place."""


class SingularMatrix(RuntimeError):
    """A pivot is zero or not a number."""


@dataclass(frozen=True)
class Factors:
    """``matrix`` in the order of `Assembly.free`, with a solver of its symmetric part ``ldl``, or
    of all of it where that is None."""

    matrix: csc_matrix
    ldl: Any

    @cached_property
    def lu(self) -> Any:
        from scipy.sparse.linalg import splu  # a tenth of the start-up, and seldom needed

        try:
            return splu(self.matrix, "MMD_AT_PLUS_A", 0.0, options=_LU_OPTIONS)
        except RuntimeError as error:
            raise SingularMatrix(str(error)) from None

    def solve(self, force: Array, tolerance: float = EXACT) -> Array:
        """Displacements (n,) or (n, r) under ``force`` of the same shape.

        Generalised conjugate residuals (Eisenstat, Elman and Schultz 1983) with L D L^T of the
        symmetric part as preconditioner: the least residual in the directions so far.
        """
        if self.ldl is None:
            return np.asarray(self.lu.solve(np.ascontiguousarray(force)))
        if force.ndim == 2:
            return np.stack([self.solve(one, tolerance) for one in force.T], axis=1)
        found, left = np.zeros_like(force), force.copy()
        wanted = tolerance * sqrt(force @ force)
        moves: list[Array] = []
        images: list[Array] = []
        while sqrt(left @ left) > wanted:
            if len(moves) == MAX_CORRECTIONS:
                return np.asarray(self.lu.solve(force))
            move = np.asarray(self.ldl.solve(left))
            image = np.asarray(self.matrix @ move)
            for earlier, its_image in zip(moves, images, strict=True):
                share = float(its_image @ image)
                move, image = move - share * earlier, image - share * its_image
            size = sqrt(image @ image)
            if not 0 < size < np.inf:
                raise SingularMatrix("the factors are not finite")
            moves.append(move / size)
            images.append(image / size)
            share = float(images[-1] @ left)
            found, left = found + share * moves[-1], left - share * images[-1]
        return found

    @cached_property
    def negative(self) -> int:
        """How many pivots are negative: without row exchanges, as many as negative eigenvalues.

        A symmetric part without any leaves none to the matrix (Bendixson 1902). One with some says
        little: where lumen pressure acts on a thinning section it has an eigenvalue of -17 beside
        the matrix' own 13. Then the pivots of the matrix itself count.
        """
        if self.ldl is not None and (np.asarray(self.ldl.factors()[1]) > 0).all():
            return 0
        return int((self.lu.U.diagonal() < 0).sum())


class Assembly:
    """Sums blocks into the matrix of the free displacements and factorises it.

    ``blocks`` are groups of element displacement numbers (m, d); every group may bring matrices
    (m, d, d) to `factor`. ``fixed`` displacements are held.
    """

    def __init__(self, size: int, blocks: list[Ints], fixed: Ints) -> None:
        self.size = size
        self.free = np.setdiff1d(np.arange(size), fixed)
        n = len(self.free)
        number = np.full(size, -1)
        number[self.free] = np.arange(n)
        rows, columns = [], []
        for dofs in blocks:
            local = number[dofs]
            rows.append(np.repeat(local, local.shape[1], axis=1).ravel())
            columns.append(np.tile(local, (1, local.shape[1])).ravel())
        row, column = np.concatenate(rows), np.concatenate(columns)
        kept = (row >= 0) & (column >= 0)
        row_of, column_of, index = _distinct(row[kept], column[kept], n)
        self._rows = row_of.astype(np.int32)
        starts = np.searchsorted(column_of, np.arange(n + 1)).astype(np.int32)
        self._index = np.full(len(row), len(row_of))
        self._index[kept] = index
        self._upper = np.flatnonzero(self._rows <= column_of)
        # the pattern is symmetric: what is k-th by columns is transposed into what is k-th by rows
        by_columns = csc_matrix((np.arange(len(row_of)), self._rows, starts), shape=(n, n))
        self._transposed = by_columns.tocsr().data[self._upper]
        upper_starts = np.searchsorted(column_of[self._upper], np.arange(n + 1))
        self._matrix = csc_matrix((np.zeros(len(row_of)), self._rows, starts), shape=(n, n))
        self._half = csc_matrix(
            (np.zeros(len(self._upper)), self._rows[self._upper], upper_starts), shape=(n, n)
        )
        self._ldl: Any = None

    def __getstate__(self) -> dict[str, Any]:
        """Without the factors, which are the library's own and cannot be kept."""
        return self.__dict__ | {"_ldl": None}

    def factor(self, matrices: list[Array]) -> Factors:
        """Factors of the summed blocks, one (m, d, d) array per group, in the groups' order.

        They hold until the next call: matrix and symbolic analysis are shared. Raises
        `SingularMatrix`.
        """
        values = self._matrix.data = self._summed(matrices)
        if qdldl is None:
            return Factors(self._matrix, None)
        self._half.data = (values[self._upper] + values[self._transposed]) / 2
        try:
            if self._ldl is None:
                self._ldl = qdldl.Solver(self._half, upper=True)
            else:
                self._ldl.update(self._half, upper=True)
        except RuntimeError as error:
            self._ldl = None
            raise SingularMatrix(str(error)) from None
        return Factors(self._matrix, self._ldl)

    def near_factored(self, matrices: list[Array]) -> Factors:
        """As `factor`, of blocks that hardly differ from those that were last factorised: their
        factors do as a preconditioner, but their pivots tell nothing."""
        if self._ldl is None:
            return self.factor(matrices)
        self._matrix.data = self._summed(matrices)
        return Factors(self._matrix, self._ldl)

    def _summed(self, matrices: list[Array]) -> Array:
        """The entries of the whole matrix. Raises `SingularMatrix`."""
        data = np.concatenate([m.ravel() for m in matrices])
        count = len(self._rows)
        sums = np.bincount(self._index, weights=data, minlength=count + 1)[:count]
        if not np.isfinite(sums).all():
            raise SingularMatrix("an entry is not a number")
        return sums.astype(np.float64, copy=False)

    def solve(self, factors: Factors, force: Array, tolerance: float = CLOSE) -> Array:
        """Displacements (size,) or (size, r) under ``force`` of the same shape; 0 where held."""
        result = np.zeros_like(force)
        result[self.free] = factors.solve(force[self.free], tolerance)
        return result


def _distinct(row: Ints, column: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """Rows (e,) and columns (e,) of the entries that occur, column by column, and the number (k,)
    of each given one; all are below ``count``.

    Numbers of sixteen bits are sorted by their digits, in a quarter of `numpy.unique`'s time.
    """
    short = np.min_scalar_type(count)
    order = np.lexsort((row.astype(short), column.astype(short)))
    row, column = row[order], column[order]
    new = np.append(True, (row[1:] != row[:-1]) | (column[1:] != column[:-1]))
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return row[new], column[new], number


def gather(size: int, dofs: Ints, forces: Array) -> Array:
    """Sum element forces (m, d) into (size,)."""
    total = np.bincount(dofs.ravel(), weights=forces.ravel(), minlength=size)
    return total.astype(np.float64, copy=False)
