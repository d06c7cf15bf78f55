"""What the error of a press by a body of revolution is made of."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from own_scene import BALL

from sim_backend.models import solid_press
from sim_backend.scene.scene_file import scene_from_text


@dataclass(frozen=True)
class Solved:
    force_n_per_m: float


def test_both_round_blocks_lie_within_the_stated_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The true block, between the round one within and the one around it, may be near either."""
    forces_n = iter((0.9, 1.1))

    def refined(*_given: Any, **_more: Any) -> SimpleNamespace:
        return SimpleNamespace(solved=(None, (Solved(next(forces_n)),)), error_pct=np.zeros(2))

    monkeypatch.setattr(solid_press, "refine", refined)
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    _, solution, error_pct = solid_press.refine_axisymmetric(scene, 32e-3, 1e-3, 1.0)
    assert solution.force_n_per_m == pytest.approx(1.0)
    assert error_pct == pytest.approx(10.0)


@pytest.mark.parametrize("pressures_pa", [(0.0,), (80.0, 120.0)])
def test_meshes_that_agree_by_chance_do_not_state_no_error(
    pressures_pa: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def solved(*_given: Any, **_more: Any) -> tuple[SimpleNamespace, list[SimpleNamespace]]:
        return SimpleNamespace(free=range(10)), [
            SimpleNamespace(force_n=1 + p) for p in pressures_pa
        ]

    monkeypatch.setattr(solid_press, "solve_solid", solved)
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    budget = np.full(2, 5.0)
    _, (force_pct, pulse_pct) = solid_press.refine_solid(scene, 0.0, 1e-3, pressures_pa, budget)
    assert 1.7 < force_pct < 3.0  # a cylinder's second mesh missed as much
    assert 1.7 < pulse_pct < 3.0 if len(pressures_pa) > 1 else pulse_pct == 0.0
