"""Derivatives of solved solids: laws of scale, and the same press solved again."""

from typing import Any

import numpy as np
import pytest
from small_solid import small_solid

from sim_backend.fem.newton import as_solved, equilibrium
from sim_backend.fem.sensitivity import LOADS, gradients, loaded, renumbered
from sim_backend.fem.solid import body as solid_body
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.models.press import press
from sim_backend.scene.numbers import numbers
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.waves import PA_PER_MMHG

X_MM, DEPTH_MM = 11.5, 0.8
LUMP = {"kind": "tumour", "x_mm": 12.0, "depth_mm": 5.0, "diameter_mm": 4.0, "modulus_kpa": 500.0,
        "poisson": 0.45}  # fmt: skip
ARTERY = {"kind": "artery", "x_mm": 12.0, "depth_mm": 5.0, "inner_diameter_mm": 3.0, "wall_mm": 0.6,
          "modulus_kpa": 300.0, "poisson": 0.45}  # fmt: skip


def solid(inclusion: dict[str, Any]) -> Scene:
    return small_solid(24.0, 24.0, inclusion, height_mm=12.0)


@pytest.fixture(autouse=True)
def _solved_to_rounding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which differences of forces need."""
    monkeypatch.setattr(solid_body, "TOLERANCE", 1e-10)
    monkeypatch.setattr(solid_body, "CLOSED_SHARE", 1e-9)
    monkeypatch.setattr(solid_body, "ITERATIONS", 60)


@pytest.mark.parametrize(("inclusion", "mmhg"), [(LUMP, 0.0), (ARTERY, 80.0)])
def test_a_solid_s_derivatives(inclusion: dict[str, Any], mmhg: float) -> None:
    """Force goes with moduli and pressure together, and with the square of all lengths."""
    scene = solid(inclusion)
    place = 1e-3 * X_MM, 1e-3 * DEPTH_MM
    body, (here,) = solve_solid(
        scene, *place, [mmhg * PA_PER_MMHG], 0.4 * scene.indenter.profile.scale, judge=False
    )
    found = gradients(body, here, scene)
    assert set(found) == {*LOADS, *numbers(scene)}
    values = {**numbers(scene), "x_mm": X_MM, "depth_mm": DEPTH_MM, "pressure_mmhg": mmhg}
    change = {key: values[key] * by for key, by in found.items()}
    elastic = sum(one for key, one in change.items() if key.endswith(("_kpa", "_mmhg")))
    lengths = sum(one for key, one in change.items() if key.endswith("_mm"))
    assert elastic == pytest.approx(here.force, rel=1e-5)
    assert lengths == pytest.approx(2 * here.force, rel=1e-5)
    for key in ("depth_mm", "inclusion.0.depth_mm"):
        by = loaded if key in LOADS else renumbered
        number = by(as_solved(body, here), here.load, key, scene)
        forces = []
        for sign in (1, -1):
            other, load = number.moved(10 * sign * number.step)
            again = equilibrium(other, here, load)
            np.testing.assert_array_equal(again.multiplier[0] > 0, here.multiplier[0] > 0)
            forces.append(again.force)
        again = (forces[0] - forces[1]) / (20 * number.step)
        assert found[key] == pytest.approx(again, rel=1e-5), key


def test_a_vessel_with_a_path_has_no_gradient() -> None:
    scene = solid(ARTERY | {"path": [[-12.0, 11.0, 5.0], [12.0, 13.0, 5.0]]})
    with pytest.raises(SceneError, match="path"):
        press(scene, X_MM, DEPTH_MM, [80.0], gradient=True)
