"""Sparse tangents of solids: one pattern, and flexible GMRES preconditioned by earlier factors.

Flexible GMRES (Saad 1993) keeps the preconditioned vectors, of which the solution is a sum. New
factors are made where it takes too long. All is in single precision, as the tangents are: a Newton
step needs no more, and time goes with the bytes that are read.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix
from scipy.sparse.linalg import LinearOperator, gcrotmk

from sim_backend.arrays import Array, Blocks, Ints, Singles
from sim_backend.fem import kernel
from sim_backend.fem.assembly import SingularMatrix
from sim_backend.fem.body import Tangent
from sim_backend.fem.solid.dissection import dissected
from sim_backend.fem.solid.fronts import Factors, Plan

RELATIVE = 1e-4
"""How far a Newton step's residual falls, where not less is enough: its own error is squared
anyway. Balls of 4, 5 and 6.5 mm, each pressed on two meshes of up to 17,511 unknowns, take 70
Newton steps and 511 Krylov steps in all; with 1e-5 70 and 577, with 1e-3 78 and 590."""
GOOD = 1e-3
USEFUL = 0.1
"""What a step may leave of the residual where no more is to be had: Newton's method then converges
linearly (Dembo, Eisenstat and Steihaug 1982)."""
REFINEMENTS = 4
MOST_STEPS, SLOW_STEPS = 30, 15
"""Krylov steps after which new factors are made at once, and for the next Newton step."""


class LinearSolver:
    """Solves for the displacements of ``nodes`` (n, 3) that ``groups`` of node numbers (m, k) join:
    elements, and after them what lies on their sides; the last, ``beyond`` elements, join walls
    that may touch.

    ``fixed`` displacement numbers stay zero. ``leaning`` are (stiffness, weights (3n,)) of averages
    that are fixed: dense, so that factors see their diagonals instead.
    """

    exact = False

    def __init__(
        self,
        nodes: Array,
        groups: list[Ints],
        fixed: Ints,
        leaning: list[tuple[float, Array]],
        beyond: Sequence[Ints] = (),
    ) -> None:
        groups = [*groups, *beyond]
        used = np.zeros(len(nodes), dtype=bool)
        for group in groups:
            used[group] = True
        number = np.cumsum(used) - 1
        n = int(used.sum())
        keys = [number[g][:, :, None] * n + number[g][:, None, :] for g in groups]
        unique, index = np.unique(np.concatenate([k.ravel() for k in keys]), return_inverse=True)
        rows, columns = np.divmod(unique, n)
        graph = csr_matrix((np.ones(len(unique), np.float32), (rows, columns)), shape=(n, n))
        order, fronts = dissected(
            nodes[used], [number[group] for group in (groups[0], *beyond)], graph
        )
        place = np.empty(n, dtype=np.int64)
        place[order] = np.arange(n)
        ahead = np.argsort(place[rows] * n + place[columns])
        rows, self._columns = place[rows[ahead]], place[columns[ahead]]
        rank = np.empty(len(unique), dtype=np.int64)
        rank[ahead] = np.arange(len(unique))
        self._starts = np.searchsorted(rows, np.arange(n + 1))
        self._places = _places(groups, rank[index])
        self._plan = Plan(fronts, self._starts, self._columns)
        self._dofs = (3 * np.flatnonzero(used)[order][:, None] + np.arange(3)).ravel()
        still = np.zeros(3 * len(nodes), dtype=bool)
        still[fixed] = True
        self._still = still[self._dofs].reshape(n, 3)
        touched = self._still.any(axis=1)
        self._partly = np.flatnonzero(touched[rows] | touched[self._columns])
        free = ~self._still
        self._mask = (
            free[rows[self._partly]][:, :, None] & free[self._columns[self._partly]][:, None]
        )
        self._diagonal = np.flatnonzero(rows == self._columns)
        self._leaning = [(s, (w[self._dofs] * free.ravel())) for s, w in leaning]
        self._size = 3 * len(nodes)
        self._factors: Factors | None = None
        self._inverse: tuple[Factors, Callable[[Singles], Singles]] | None = None
        self._negative = 0
        self._tangent: bsr_matrix | None = None
        self._simpler: Callable[[], bsr_matrix] | None = None
        self._rough = False

    def linearise(self, tangent: Tangent, *, careful: bool = False, rough: bool = False) -> None:
        """Factors do without the normals' turning, with which a node on an edge may have no pivot;
        a ``careful`` step does where the tangent would not be definite."""
        joined, lumens = self.joined(tangent.body[0]), tangent.body[1:]
        with_turning = [s + t for s, t in zip(tangent.springs, tangent.turning, strict=True)]
        self._tangent = self.matrix(joined, *lumens, *with_turning)
        if careful and not self.is_definite(self.matrix(joined, *_even(lumens), *with_turning)):
            self._tangent = self.matrix(joined, *lumens, *tangent.springs)
        self._simpler = partial(self.matrix, joined, *_even(lumens), *tangent.springs)
        self._rough = rough

    def step(self, force: Array, enough: float) -> Array:
        assert self._tangent is not None
        found = self.solve(self._tangent, force, self._simpler, enough)
        if self._rough:  # without the pressure its factors serve no other tangent
            self.forget()
        return found

    def is_stable(self, tangent: Tangent) -> bool | None:
        """True where all pivots are positive, False where a displacement is found that releases
        energy, None where neither: single precision does not decide eigenvalues near zero. The
        factors serve the next step."""
        self.forget()
        matrix = self._symmetric(tangent)
        try:
            self._factors = self.factor(matrix)
        except SingularMatrix:
            return None
        if not self._factors.negative:
            return True
        return False if self._released(matrix, self._factors.releasing()) < 0 else None

    def releasing(self, tangent: Tangent) -> Array | None:
        """A displacement (size,) that releases energy; None without one."""
        matrix = self._symmetric(tangent)
        factors = self.factor(matrix)
        if not factors.negative:
            return None
        x = factors.releasing()
        x[self._still.ravel()] = 0.0
        if self._released(matrix, x) >= 0:
            return None
        result = np.zeros(self._size)
        result[self._dofs] = x
        return result

    def times(self, tangent: Tangent, u: Array) -> Array:
        """The tangent times displacements (size,)."""
        x = u[self._dofs].astype(np.float32)
        result = np.zeros(self._size)
        result[self._dofs] = self._product(self._symmetric(tangent), x)
        return result

    def _symmetric(self, tangent: Tangent) -> bsr_matrix:
        cells, *lumens = tangent.body
        touching = tangent.blocks[len(tangent.body) :]
        return self.matrix(self.joined(cells), *_even(lumens), *touching)

    def joined(self, blocks: Blocks) -> Singles:
        """The sums (p, 3, 3) of the elements' tangents (m, 3k, 3k), the first group's, for each
        pair of nodes that elements join."""
        place = self._places[0]
        m, k, _ = place.shape
        sums = np.zeros((len(self._columns), 3, 3), dtype=np.float32)
        if kernel.BUILT:
            kernel.join_blocks(np.ascontiguousarray(blocks, dtype=np.float32), place, sums)
            return sums
        parts = blocks.reshape(m, 3, k, 3, k)
        for i, j in np.ndindex(3, 3):
            weights = parts[:, i, :, j].ravel()
            sums[:, i, j] = np.bincount(place.ravel(), weights=weights, minlength=len(sums))
        return sums

    def matrix(self, joined: Singles, *sides: Blocks) -> bsr_matrix:
        """The tangent, without what leans, from the elements' sums and one (m, 3k, 3k) array per
        group after them; one on the diagonal of what is fixed."""
        values = joined.copy()
        for place, block in zip(self._places[1:], sides, strict=True):
            m, k, _ = place.shape
            pairs = block.astype(np.float32).reshape(m, 3, k, 3, k).transpose(0, 2, 4, 1, 3)
            np.add.at(values, place, pairs)
        values[self._partly] *= self._mask
        scale = float(np.abs(values[self._diagonal, 0, 0]).max())
        values[self._diagonal[:, None], [0, 1, 2], [0, 1, 2]] += scale * self._still
        n = self._dofs.size
        return bsr_matrix((values, self._columns, self._starts), shape=(n, n))

    def solve(
        self,
        matrix: bsr_matrix,
        force: Array,
        simpler: Callable[[], bsr_matrix] | None = None,
        enough_n: float = 0.0,
    ) -> Array:
        """Displacements (size,) under ``force`` (size,) [N], of which ``enough_n`` may be left.

        Raises `SingularMatrix`. New factors are those of a ``simpler`` matrix, where there is one.
        """
        right = force[self._dofs].astype(np.float32)
        right[self._still.ravel()] = 0.0
        result = np.zeros(self._size)
        if not np.isfinite(right).all():
            raise SingularMatrix("no solution was found")
        if not np.any(right):
            self._negative = 0
            return result
        x, taken = None, 0
        if self._factors is not None:
            x, taken = self._krylov(matrix, right, self._factors, MOST_STEPS, enough_n)
        if x is None:
            self._factors = self.factor(simpler() if simpler else matrix)
            x, taken = self._refined(matrix, right, self._factors, enough_n)
        assert self._factors is not None
        self._negative = self._factors.negative
        if taken > SLOW_STEPS:
            self._factors = None
        x[self._still.ravel()] = 0.0
        result[self._dofs] = x
        return result

    def is_definite(self, matrix: bsr_matrix) -> bool:
        """Whether all pivots of ``matrix`` are positive; its factors then serve the next `solve`,
        which else makes new ones."""
        self.forget()
        try:
            factors = self.factor(matrix)
        except SingularMatrix:
            return False
        self._factors = None if factors.negative else factors
        return not factors.negative

    def forget(self) -> None:
        """The next `solve` makes factors of its own."""
        self._factors = None

    @property
    def negative(self) -> int:
        """How many negative pivots the factors of the last `solve` have."""
        return self._negative

    def _released(self, matrix: bsr_matrix, x: Singles) -> float:
        """x A x, summed in double precision: negative where energy is released."""
        exact = x.astype(np.float64)
        energy = float(exact @ (matrix.astype(np.float64) @ exact))
        return energy + sum(s * float(weight @ exact) ** 2 for s, weight in self._leaning)

    def _product(self, matrix: bsr_matrix, x: Singles) -> Singles:
        if kernel.BUILT:
            y = np.empty_like(x)
            kernel.block_product(matrix.data, self._columns, self._starts, x, y)
        else:
            y = matrix @ x
        for stiffness, weight in self._leaning:
            y += stiffness * float(weight @ x) * weight
        return y

    def _leaned(self, factors: Factors) -> Callable[[Singles], Singles]:
        """The inverse of what ``factors`` are of and of the averages that are fixed, by the formula
        of Sherman, Morrison and Woodbury: of the averages ``factors`` have the diagonal only. A
        vessel that runs obliquely through free ends turns the block by its pressure, which those
        alone would not hold."""
        if not self._leaning:
            return factors.solve
        weights = np.array([weight for _, weight in self._leaning])
        gives = np.array([factors.solve(weight) for weight in weights])
        capacitance = np.diag([1 / s for s, _ in self._leaning]) + weights @ gives.T
        share = np.linalg.solve(capacitance, gives)

        def solve(right: Singles) -> Singles:
            x = factors.solve(right)
            return np.asarray(x - (weights @ x) @ share, dtype=np.float32)

        return solve

    def factor(self, matrix: bsr_matrix) -> Factors:
        """Factors of ``matrix`` and the diagonals of what leans. Raises `SingularMatrix`."""
        propped = matrix.copy() if self._leaning else matrix
        for stiffness, weight in self._leaning:
            on_diagonal = stiffness * (weight**2).reshape(-1, 3)
            propped.data[self._diagonal[:, None], [0, 1, 2], [0, 1, 2]] += on_diagonal
        return Factors(self._plan, propped)

    def _refined(
        self, matrix: bsr_matrix, right: Singles, factors: Factors, enough_n: float
    ) -> tuple[Singles, int]:
        """By iterative refinement, with what is left summed in double precision (Carson and Higham
        2018): near a limit point displacements are so large that single precision rounds off more
        than what may be left of the forces. Raises `SingularMatrix`."""
        x, left, taken = np.zeros(len(right)), right.astype(np.float64), 0
        exact = matrix.astype(np.float64)
        whole_n = float(np.linalg.norm(right))
        for _ in range(REFINEMENTS):
            more, steps = self._cycle(matrix, left.astype(np.float32), factors, enough_n)
            x, taken = x + more, taken + steps
            left = right - exact @ x
            for stiffness, weight in self._leaning:
                left -= stiffness * float(weight @ x) * weight
            left_n = float(np.linalg.norm(left))
            if left_n <= max(GOOD * whole_n, 2 * enough_n):
                break
        if not left_n <= max(USEFUL * whole_n, 2 * enough_n):
            raise SingularMatrix("no displacements balance the forces")
        return x.astype(np.float32), taken

    def _krylov(
        self, matrix: bsr_matrix, right: Singles, factors: Factors, most: int, enough_n: float
    ) -> tuple[Singles | None, int]:
        x, counted = self._cycle(matrix, right, factors, enough_n, most)
        if not np.all(np.isfinite(x)):
            return None, counted
        left_n = float(np.linalg.norm(right - self._product(matrix, x)))
        good = left_n <= max(GOOD * float(np.linalg.norm(right)), 2 * enough_n)
        return (x if good else None), counted

    def _cycle(
        self,
        matrix: bsr_matrix,
        right: Singles,
        factors: Factors,
        enough_n: float,
        most: int = 2 * MOST_STEPS,
    ) -> tuple[Singles, int]:
        """One cycle of flexible GMRES, and its number of steps."""
        if self._inverse is None or self._inverse[0] is not factors:
            self._inverse = factors, self._leaned(factors)
        inverse = self._inverse[1]
        counted = 0

        def counting(y: Singles) -> Singles:
            nonlocal counted
            counted += 1
            return inverse(y)

        shape = (len(right), len(right))
        # with k = 0 and one outer iteration: one cycle of flexible GMRES, nothing of it kept
        x, _ = gcrotmk(
            LinearOperator(shape, lambda y: self._product(matrix, y), dtype=right.dtype), right,
            M=LinearOperator(shape, counting, dtype=right.dtype),
            rtol=RELATIVE, atol=enough_n, m=most, k=0, maxiter=1,
        )  # fmt: skip
        return np.asarray(x), counted


def _even(lumens: Sequence[Blocks]) -> list[Blocks]:
    """The symmetric part of lumens' tangent blocks: at a lumen's open ends there is another, which
    in factors, of which half is made, would weigh as much as the softest displacements."""
    return [(block + np.swapaxes(block, 1, 2)) / 2 for block in lumens]


def _places(groups: list[Ints], block: Ints) -> list[Ints]:
    """(m, k, k) per group: where each pair of nodes goes among the blocks."""
    start, places = 0, []
    for group in groups:
        m, k = group.shape
        places.append(np.ascontiguousarray(block[start : start + m * k * k].reshape(m, k, k)))
        start += m * k * k
    return places
