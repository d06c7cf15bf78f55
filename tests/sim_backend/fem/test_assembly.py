"""The linear solver: solutions and negative pivots of matrices that are known."""

import numpy as np
import pytest

from sim_backend.fem.assembly import Assembly, SingularMatrix

SIZE = 40
HELD = np.array([3, 18])
pytestmark = pytest.mark.usefixtures("with_and_without_kernel")


def blocks() -> np.ndarray:
    """Three nodes each, overlapping by one: a chain."""
    return np.array([[k, k + 1, k + 2] for k in range(0, SIZE - 2, 2)] + [[0, SIZE - 1, 5]])


def matrices(negative: int, skew: float) -> np.ndarray:
    """Block matrices (m, 3, 3), ``negative`` diagonal entries of their sum far below zero."""
    rng = np.random.default_rng(4)
    one = rng.standard_normal((len(blocks()), 3, 3))
    found = one @ np.swapaxes(one, 1, 2) + 2 * np.eye(3)
    for k in range(negative):
        found[4 * k, 1, 1] -= 500.0
    return found + skew * (one - np.swapaxes(one, 1, 2))


def dense(data: np.ndarray) -> np.ndarray:
    whole = np.zeros((SIZE, SIZE))
    for dofs, block in zip(blocks(), data, strict=True):
        whole[np.ix_(dofs, dofs)] += block
    free = np.setdiff1d(np.arange(SIZE), HELD)
    return whole[np.ix_(free, free)]


@pytest.mark.parametrize("negative", [0, 1, 3])
@pytest.mark.parametrize("skew", [0.0, 0.2])
def test_solves_and_counts_negative_eigenvalues(negative: int, skew: float) -> None:
    made = Assembly(SIZE, [blocks()], HELD, unsymmetric=[0] if skew else [])
    data = matrices(negative, skew)
    for _ in range(2):  # the second time on the first one's analysis
        factors = made.factor([data])
        force = np.random.default_rng(1).standard_normal(SIZE)
        found = factors.solve(force)
        assert not found[HELD].any()
        expected = np.linalg.solve(dense(data), force[made.free])
        np.testing.assert_allclose(found[made.free], expected, rtol=1e-6, atol=1e-9)
        assert factors.negative == negative == (np.linalg.eigvals(dense(data)).real < 0).sum()


def test_several_right_hand_sides_are_solved_as_one_by_one() -> None:
    made = Assembly(SIZE, [blocks()], HELD)
    factors = made.factor([matrices(0, 0.1)])
    force = np.random.default_rng(1).standard_normal((SIZE, 3))
    together = factors.solve(force)
    apart = [factors.solve(one) for one in force.T]
    np.testing.assert_allclose(together, np.stack(apart, axis=1), rtol=1e-7, atol=1e-10)


def test_the_sum_times_displacements() -> None:
    made, data = Assembly(SIZE, [blocks()], HELD), matrices(0, 0.1)
    u = np.random.default_rng(1).standard_normal(SIZE)
    u[HELD] = 0.0
    np.testing.assert_allclose(made.times([data], u)[made.free], dense(data) @ u[made.free])


def test_what_cannot_be_factorised_is_said() -> None:
    made = Assembly(SIZE, [blocks()], HELD)
    for entry in (np.nan, 0.0):
        with pytest.raises(SingularMatrix):
            made.factor([np.full((len(blocks()), 3, 3), entry)])
