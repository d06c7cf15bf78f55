"""Factors of a symmetric matrix of 3 x 3 blocks, front by front (Duff and Reid 1983).

Each front is a dense matrix in single precision, since factors only precondition. A front whose
pivots are not positive is factorised by its eigenvalues; their signs add up to the number of the
matrix' negative eigenvalues (Haynsworth 1968).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import eigh
from scipy.linalg.blas import ssyrk, strsm, strsv
from scipy.linalg.lapack import spotrf
from scipy.sparse import bsr_matrix

from sim_backend.arrays import Array, Ints, Singles
from sim_backend.fem import kernel
from sim_backend.fem.assembly import SingularMatrix
from sim_backend.fem.solid.dissection import Front

SMALLEST = 1e-7
"""A pivot's eigenvalue below this share of the largest is zero: single precision ends there."""


@dataclass(frozen=True)
class _Pivots:
    """One front's pivots A = T^-T S T^-1 and T^T B (p, b), B what couples them to the border.

    T is ``root`` (p, p), or where ``signs`` S (p,) is None the inverse of ``root``, upper
    triangular; S is then one.
    """

    root: Singles
    signs: Singles | None
    coupled: Singles

    def down(self, x: Singles, span: slice, border: Ints) -> None:
        """S T^T x at the pivots ``span`` of ``x`` (n,), which is taken off the ``border``."""
        if self.signs is not None:
            x[span] = self.signs * (x[span] @ self.root)
        elif kernel.BUILT:
            kernel.front_down(self.root.T, self.coupled.T, border, x[span], x)
            return
        else:
            x[span] = strsv(self.root, x[span], trans=1)
        x[border] -= x[span] @ self.coupled

    def up(self, x: Singles, span: slice, border: Ints) -> None:
        """T (x - S T^T B x at the ``border``) at the pivots ``span``."""
        if self.signs is not None:
            x[span] = self.root @ (x[span] - self.signs * (self.coupled @ x[border]))
        elif kernel.BUILT:
            kernel.front_up(self.root.T, self.coupled.T, border, x[span], x)
        else:
            x[span] = strsv(self.root, x[span] - self.coupled @ x[border])


class Factors:
    """Of the symmetric matrix whose upper blocks ``matrix`` holds, in elimination order.

    ``negative`` counts its negative eigenvalues. Raises `SingularMatrix`.
    """

    def __init__(self, plan: "Plan", matrix: bsr_matrix) -> None:
        self._plan, self._pivots = plan, []
        self.negative = 0
        updates: dict[int, Singles] = {}
        for n, (front, scatter) in enumerate(zip(plan.fronts, plan.scatters, strict=True)):
            count, beyond = 3 * (front.last - front.first), 3 * len(front.border)
            top = np.zeros((count, count + beyond), dtype=np.float32, order="F")
            blocks = matrix.data[scatter.low : scatter.high][scatter.kept]
            top.ravel(order="F")[scatter.places] = blocks.ravel()
            rest = np.zeros((beyond, beyond), dtype=np.float32, order="F")
            for child, at in zip(front.children, scatter.children, strict=True):
                _extend(top, rest, updates.pop(child), at)
            pivots = _eliminate(top, rest)
            self._pivots.append(pivots)
            updates[n] = rest
            if pivots.signs is not None:
                self.negative += int((pivots.signs < 0).sum())

    def solve(self, right: Array | Singles) -> Singles:
        """(n,) for ``right`` (n,)."""
        x = right.astype(np.float32)
        steps = list(zip(self._plan.spans, self._plan.borders, self._pivots, strict=True))
        for span, border, pivots in steps:
            pivots.down(x, span, border)
        return self._up(x, len(steps))

    def releasing(self) -> Singles:
        """A displacement x (n,) for which x A x is -1, to single precision: the first negative
        pivot's, with what was eliminated before it following at no force. Raises ValueError where
        no pivot is negative."""
        for n, pivots in enumerate(self._pivots):
            if pivots.signs is not None and (pivots.signs < 0).any():
                x = np.zeros(self._plan.spans[-1].stop, dtype=np.float32)
                x[self._plan.spans[n]] = pivots.root[:, np.argmin(pivots.signs)]
                return self._up(x, n)
        raise ValueError("no pivot is negative")

    def _up(self, x: Singles, fronts: int) -> Singles:
        """Back substitution through the first ``fronts``, last first."""
        steps = list(zip(self._plan.spans, self._plan.borders, self._pivots, strict=True))
        for span, border, pivots in reversed(steps[:fronts]):
            pivots.up(x, span, border)
        return x


@dataclass(frozen=True)
class _Scatter:
    """Blocks ``low`` to ``high`` of the matrix belong to a front, ``kept`` (k,) of them at
    ``places`` (9k,) of its pivots' rows. ``children``: the numbers in the front, its pivots first,
    of the nodes of each child's border."""

    low: int
    high: int
    kept: Ints
    places: Ints
    children: tuple[Ints, ...]


class Plan:
    """Where the blocks of all matrices with one pattern (``starts``, ``columns``) go."""

    def __init__(self, fronts: list[Front], starts: Ints, columns: Ints) -> None:
        self.fronts = fronts
        self.scatters = [_scatter(front, fronts, starts, columns) for front in fronts]
        self.spans = [slice(3 * front.first, 3 * front.last) for front in fronts]
        self.borders = [(3 * front.border[:, None] + np.arange(3)).ravel() for front in fronts]


def _scatter(front: Front, fronts: list[Front], starts: Ints, columns: Ints) -> _Scatter:
    low, high = int(starts[front.first]), int(starts[front.last])
    pivots = np.arange(front.first, front.last)
    nodes = np.concatenate([pivots, front.border])
    rows = np.repeat(pivots - front.first, np.diff(starts[front.first : front.last + 1]))
    kept = np.flatnonzero(columns[low:high] >= front.first)
    row, column = rows[kept], np.searchsorted(nodes, columns[low:high][kept])
    three, height = np.arange(3), 3 * len(pivots)
    across = height * (3 * column[:, None, None] + three)
    places = 3 * row[:, None, None] + three[:, None] + across
    children = tuple(np.searchsorted(nodes, fronts[child].border) for child in front.children)
    return _Scatter(low, high, kept, places.ravel(), children)


def _extend(top: Singles, rest: Singles, update: Singles, at: Ints) -> None:
    """Add the upper half of a child's ``update`` at the nodes ``at`` of the front."""
    if kernel.BUILT:
        kernel.extend_front(update.T, at, top.T, rest.T)
        return
    over = top[:, len(top) :]
    runs = _runs(at, len(top) // 3)
    for n, (rows, into_rows, pivot_rows) in enumerate(runs):
        for columns, into_columns, pivot_columns in runs[n:]:
            part = (top if pivot_columns else over) if pivot_rows else rest
            part[into_rows, into_columns] += update[rows, columns]


def _runs(at: Ints, pivots: int) -> list[tuple[slice, slice, bool]]:
    """Stretches of a child's border whose places ``at`` in the front follow one another: where they
    lie in the child, and in the front's pivots or its rest."""
    if not len(at):
        return []
    breaks = (np.diff(at) != 1) | (at[1:] == pivots)
    ends = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(at)]
    runs = []
    for start, end in pairwise(ends):
        into = int(at[start]) if at[start] < pivots else int(at[start]) - pivots
        places = slice(3 * into, 3 * (into + end - start))
        runs.append((slice(3 * start, 3 * end), places, bool(at[start] < pivots)))
    return runs


def _eliminate(top: Singles, rest: Singles) -> _Pivots:
    """The pivots of ``top`` [A, B]; what they leave of the others is taken off ``rest`` (its
    upper half). All three are overwritten."""
    count = len(top)
    block, over = top[:, :count], top[:, count:]
    root, failed = spotrf(block, clean=0)
    if failed:
        return _by_eigenvalues(block, over, rest)
    if rest.size:
        over = strsm(1.0, root, over, trans_a=1, overwrite_b=1)
        ssyrk(-1.0, over, beta=1.0, c=rest, trans=1, overwrite_c=1)
    return _Pivots(root, None, over)


def _by_eigenvalues(block: Singles, over: Singles, rest: Singles) -> _Pivots:
    whole = np.triu(block) + np.triu(block, 1).T
    if not np.isfinite(whole).all():
        raise SingularMatrix("a pivot is zero or not a number")
    value, vector = eigh(whole, check_finite=False)
    if np.abs(value).min() <= SMALLEST * np.abs(value).max():
        raise SingularMatrix("a pivot is zero or not a number")
    root = np.asfortranarray(vector / np.sqrt(np.abs(value)))
    signs = np.sign(value)
    coupled = root.T @ over
    rest -= (coupled.T * signs) @ coupled
    return _Pivots(root, signs, coupled)
