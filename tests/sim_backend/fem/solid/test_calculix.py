"""Solids against presses that CalculiX solved on hexahedra of its own, kept with their decks
(`benchmarks/calculix_solids.py` at c51866cd made them)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paths import SHARED

from sim_backend.fem.solid.build import half_width_m
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.models.bodies import SOLID_LEFT
from sim_backend.models.press import press
from sim_backend.models.solid_meshes import SHARES
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

FOLDER = Path(__file__).parents[3] / "data" / "presses"


def kept(name: str) -> tuple[Scene, dict[str, Any]]:
    solved = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    return Scene.model_validate(solved["scene"]), solved


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name, model, force, pulse", [
    ("ball-over-ball", "axisymmetric", 0.005, 0.0),
    ("cylinder-with-ends", "solid", 0.01, 0.015),
    ("part-length-stenosis", "solid", 0.01, 0.015),
])  # fmt: skip
def test_force_and_pulse_are_calculix_s(name: str, model: str, force: float, pulse: float) -> None:
    scene, solved = kept(name)
    middle_mm = scene.inclusion[0].x_mm
    pressed = press(scene, middle_mm, solved["depth_mm"], solved["pressures_mmhg"], model=model,
                    accuracy_pct=5.0)  # fmt: skip
    assert pressed.error_estimate_pct < 5.0
    assert_agrees([one.force_n for one in pressed.states], solved, force, pulse)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_what_scans_are_solved_on_misses_no_more_than_is_stated() -> None:
    """A ball over an artery, on the first mesh; the other scenes are solved on the second."""
    scene, solved = kept("TIHA-ball")
    levels_pa = [p * PA_PER_MMHG for p in solved["pressures_mmhg"]]
    size_m = SHARES[0] * half_width_m(scene)
    _, states = solve_solid(scene, 32e-3, 1e-3 * solved["depth_mm"], levels_pa, size_m)
    force_n = [one.force_n for one in states]
    assert_agrees(force_n, solved, SOLID_LEFT.rest, SOLID_LEFT.change)
    if (shared := SHARED / "reference" / "solid" / "TIHA-ball.json").is_file():
        theirs = json.loads(shared.read_text("utf-8"))[-1]
        assert theirs["pressures_mmhg"] == solved["pressures_mmhg"]
        assert_agrees(force_n, theirs, SOLID_LEFT.rest, SOLID_LEFT.change)


def assert_agrees(ours_n: list[float], solved: dict[str, Any], force: float, pulse: float) -> None:
    """Forces, and their changes from one pressure to the next, within shares of them."""
    np.testing.assert_allclose(ours_n, solved["force_n"], rtol=force)
    np.testing.assert_allclose(np.diff(ours_n), np.diff(solved["force_n"]), rtol=pulse)
