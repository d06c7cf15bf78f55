"""Factors of fronts against dense algebra."""

from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from sim_backend.arrays import Array, Ints, Singles
from sim_backend.fem import kernel
from sim_backend.fem.assembly import SingularMatrix
from sim_backend.fem.body import Tangent
from sim_backend.fem.solid import dissection, linear
from sim_backend.fem.solid.dissection import dissected
from sim_backend.fem.solid.linear import LinearSolver


@pytest.fixture(autouse=True)
def small_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dissection, "LEAF", 8)


def chequer(n: int = 5) -> tuple[Array, Ints]:
    """Nodes of a grid and its cubes."""
    at = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(n**3).reshape(n, n, n)
    corners = [number[i : n - 1 + i, j : n - 1 + j, k : n - 1 + k].ravel()
               for i in (0, 1) for j in (0, 1) for k in (0, 1)]  # fmt: skip
    return at.astype(float), np.stack(corners, axis=1)


def solver_and_blocks(shift: float, fixed: Ints) -> tuple[LinearSolver, Singles]:
    nodes, cells = chequer()
    rng = np.random.default_rng(1)
    part = rng.standard_normal((len(cells), 24, 24))
    blocks = part @ np.swapaxes(part, 1, 2) - shift * np.eye(24)
    return LinearSolver(nodes, [cells], fixed, []), blocks.astype(np.float32)


def test_the_order_ends_with_what_parts_the_halves() -> None:
    nodes, cells = chequer()
    m = np.repeat(np.arange(len(cells)), 8)
    joins = csr_matrix((np.ones(m.size), (m, cells.ravel())))
    order, fronts = dissected(nodes, [cells], (joins.T @ joins).tocsr())
    assert sorted(order) == list(range(len(nodes)))
    assert fronts[0].first == 0
    assert fronts[-1].last == len(nodes)
    assert len(fronts[-1].border) == 0
    assert fronts[-1].last - fronts[-1].first == 25  # a plane of the grid


@pytest.mark.parametrize("shift", [0.0, 30.0])
def test_solves_and_counts_as_dense_algebra_does(shift: float) -> None:
    """With a shift, pivots of some fronts are negative."""
    fixed = np.array([0, 4, 100])
    solver, blocks = solver_and_blocks(shift, fixed)
    matrix = solver.matrix(solver.joined(blocks))
    dense = matrix.toarray()
    factors = solver.factor(matrix)
    assert factors.negative == int((np.linalg.eigvalsh(dense) < 0).sum())
    assert (factors.negative > 0) == (shift > 0)
    right = np.random.default_rng(2).standard_normal(len(dense))
    exact = np.linalg.solve(dense, right)
    off = np.linalg.norm(factors.solve(right) - exact) / np.linalg.norm(exact)
    assert off < 1e-3

    whole = np.random.default_rng(3).standard_normal(len(dense))
    found = solver.solve(matrix, whole)
    np.testing.assert_array_equal(found[fixed], 0.0)
    tangent = Tangent([blocks], [], [])
    assert solver.is_stable(tangent) is (shift <= 0)
    released = solver.releasing(tangent)
    assert (released is not None) == (shift > 0)
    if released is not None:
        np.testing.assert_array_equal(released[fixed], 0.0)
        _, cells = chequer()
        each = released.reshape(-1, 3)[cells].reshape(len(cells), 24)
        assert np.einsum("ci,cij,cj->", each, blocks, each) < 0


@pytest.mark.skipif(not kernel.BUILT, reason="the kernel was not built")
@pytest.mark.parametrize("shift", [0.0, 30.0])
def test_the_kernel_adds_up_what_numpy_does(shift: float, monkeypatch: pytest.MonkeyPatch) -> None:
    solver, blocks = solver_and_blocks(shift, np.array([0, 4, 100]))
    right = np.random.default_rng(2).standard_normal(3 * 125)

    def found() -> tuple[Singles, ...]:
        sums = solver.joined(blocks)
        matrix = solver.matrix(sums)
        times = solver._product(matrix, right.astype(np.float32))
        return sums, times, solver.factor(matrix).solve(right)

    ours = found()
    monkeypatch.setattr(kernel, "BUILT", False)
    for here, there, rounding in zip(ours, found(), (1e-6, 1e-6, 1e-4), strict=True):
        np.testing.assert_allclose(here, there, rtol=0, atol=rounding * np.abs(there).max())


def test_a_solution_that_leaves_as_much_as_it_may_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    solver, blocks = solver_and_blocks(0.0, np.array([0, 4, 100]))
    matrix = solver.matrix(solver.joined(blocks))
    factors = solver.factor(solver.matrix(solver.joined(blocks + np.eye(24, dtype=np.float32))))
    shares: list[float] = []
    gcrotmk = linear.gcrotmk

    def noted(matrix: Any, right: Singles, **given: Any) -> Any:
        """What each number of steps leaves."""
        for steps in range(1, 8):
            x, _ = gcrotmk(matrix, right, **(given | {"m": steps, "rtol": 0.0, "atol": 0.0}))
            shares.append(float(np.linalg.norm(right - matrix @ x) / np.linalg.norm(right)))
        return gcrotmk(matrix, right, **given)

    free = ~solver._still.ravel()
    for seed in range(20):
        right = np.random.default_rng(seed).standard_normal(3 * 125)
        inside = right[solver._dofs] * free
        shares.clear()
        solver._factors = factors
        with monkeypatch.context() as patched:
            patched.setattr(linear, "gcrotmk", noted)
            solver.solve(matrix, right)
        rough = [share for share in shares if share > linear.RELATIVE]
        assert rough
        for share in rough:
            enough_n = share * float(np.linalg.norm(inside))
            solver._factors = factors
            found = solver.solve(matrix, right, enough_n=enough_n)[solver._dofs]
            assert np.linalg.norm((inside - matrix @ found)[free]) <= 2 * enough_n
            assert solver._factors is factors


def test_a_loose_part_has_no_inverse() -> None:
    nodes, cells = chequer()
    solver = LinearSolver(nodes, [cells], np.array([0]), [])
    with pytest.raises(SingularMatrix):
        solver.factor(solver.matrix(solver.joined(np.zeros((len(cells), 24, 24), np.float32))))


@pytest.mark.parametrize("built", sorted({False, kernel.BUILT}))
@pytest.mark.parametrize("count", [2, 3])
def test_parts_that_nothing_connects_are_solved_each(
    built: bool, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel, "BUILT", built)
    nodes, cells = chequer(3)
    cells = np.concatenate([cells + n * len(nodes) for n in range(count)])
    nodes = np.concatenate([nodes + 10.0 * n for n in range(count)])
    part = np.random.default_rng(1).standard_normal((len(cells), 24, 24)).astype(np.float32)
    solver = LinearSolver(nodes, [cells], np.array([0]), [])
    matrix = solver.matrix(solver.joined(part @ np.swapaxes(part, 1, 2)))
    right = np.random.default_rng(2).standard_normal(3 * len(nodes))
    right[:3] = 0.0
    found = solver.solve(matrix, right)
    dense, order = matrix.toarray(), solver._dofs
    np.testing.assert_allclose(dense @ found[order], right[order], atol=1e-6 * np.abs(right).max())
