"""What a press states is what its meshes show."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_block import BLOCK

from sim_backend.fem import finite_strain
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.newton import CannotSolve, NotConverged
from sim_backend.models import refine as refining
from sim_backend.models.refine import FLOOR_PCT, ORDER, refine

HALF_M = 0.5e-3 * BLOCK.indenter.width_mm_projected


def converging(missed: float, order: float = ORDER, contacts: int = 2):
    """In place of a solver: forces of 100 and 120 N/m at the two pressures, of which a mesh as
    large as the finger's half width misses the share ``missed``. Of three ``contacts`` one is a
    lumen's walls."""

    def solve(*place, **_):
        size_m = place[-1]
        off = 1 + missed * (size_m / HALF_M) ** order
        section = SimpleNamespace(assembly=SimpleNamespace(free=np.zeros(10)), size_m=size_m)
        forces = (100.0 * off, 120.0 * off)
        return section, [
            SimpleNamespace(force_n_per_m=force, multiplier=(0,) * contacts) for force in forces
        ]

    return solve


@pytest.mark.parametrize("budget_pct", [0.3, 1.0, 3.0])
def test_an_error_that_falls_with_the_size_is_stated_as_it_is(monkeypatch, budget_pct):
    """Two meshes tell the limit exactly where errors fall by the power assumed (Roache 1994)."""
    missed = 0.5
    monkeypatch.setattr(refining, "solve_finite", converging(missed))
    found = refine("finite", BLOCK, 0.012, 1e-3, [0.0, 1e4], np.full(2, budget_pct))
    section, solutions = found.solved
    true_pct = 100 * missed * (section.size_m / HALF_M) ** ORDER
    # of the limit there, of the finest mesh here
    stated_pct = found.error_pct * solutions[0].force_n_per_m / 100.0
    assert stated_pct == pytest.approx([true_pct, true_pct], rel=1e-9)
    assert (found.error_pct <= budget_pct).all()


def test_one_that_falls_faster_is_not_stated_less(monkeypatch):
    monkeypatch.setattr(refining, "solve_finite", converging(0.5, order=2.0))
    found = refine("finite", BLOCK, 0.012, 1e-3, [0.0, 1e4], np.full(2, 1.0))
    true_pct = 50 * (found.solved[0].size_m / HALF_M) ** 2
    assert (found.error_pct >= true_pct).all()


def test_meshes_that_agree_by_chance_do_not_state_nothing(monkeypatch):
    """The least that a mesh misses: of a pulse a fifth at elements of the finger's half width,
    which at a budget of 1 % is two fifths to all of that."""
    monkeypatch.setattr(refining, "solve_finite", converging(0.0))
    found = refine("finite", BLOCK, 0.012, 1e-3, [0.0, 1e4], np.full(2, 1.0))
    share = found.solved[0].size_m / HALF_M
    assert found.error_pct == pytest.approx([6 * share**2, 20 * share**2])
    assert 0.4 < found.error_pct[1] <= 1.0
    assert list(FLOOR_PCT) == [6, 20]


@pytest.mark.parametrize(("contacts", "meshes"), [(2, 6), (3, 2)])
def test_where_walls_fold_no_third_mesh_is_pressed_from_the_air(monkeypatch, contacts, meshes):
    """TIHA 9 mm deep: 43 s went into a third mesh that found no way past the folds."""
    solve, shares = converging(0.5, contacts=contacts), []

    def nothing_carries_over(*place, must_carry: bool, **given):
        if must_carry:
            raise CannotSolve("mesh", "does not carry over")
        shares.append(place[-1] / HALF_M)
        return solve(*place, **given)

    monkeypatch.setattr(refining, "solve_finite", nothing_carries_over)
    found = refine("finite", BLOCK, 0.012, 1e-3, [0.0, 1e4], np.full(2, 0.2))
    assert len(shares) == meshes
    kept = found.solved[1][0].force_n_per_m
    assert found.error_pct[0] * kept / 100 >= (50 - 1e-9) * shares[-1] ** ORDER


def test_what_must_carry_over_and_does_not_is_not_solved(monkeypatch):
    solved = solve_finite(BLOCK, 0.012, 0.5e-3, [1e4], 1e-3)

    def fails(*_):
        raise NotConverged("elements were crushed")

    monkeypatch.setattr(finite_strain, "continued", fails)
    place = BLOCK, 0.012, 0.5e-3, [1e4], 0.7e-3
    with pytest.raises(CannotSolve, match="does not carry over"):
        solve_finite(*place, coarser=solved, must_carry=True)
    assert solve_finite(*place, coarser=solved)[1][0].force_n_per_m > 0
