"""Solids against presses that CalculiX solved on hexahedra of its own, kept with their decks
(`benchmarks/calculix_solids.py` made them)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paths import SHARED

from sim_backend.models.press import Press, press
from sim_backend.scene.scene_file import Scene

FOLDER = Path(__file__).parents[3] / "data" / "presses"


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("name", "model", "force", "pulse"),
    [
        ("ball-over-ball", "axisymmetric", 0.005, 0.0),
        ("cylinder-with-ends", "solid", 0.015, 0.02),
        ("part-length-stenosis", "solid", 0.01, 0.05),
    ],
)
def test_force_and_pulse_are_calculix_s(name: str, model: str, force: float, pulse: float) -> None:
    kept = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    scene = Scene.model_validate(kept["scene"])
    pressed = press(scene, 32.0, kept["depth_mm"], kept["pressures_mmhg"], model=model,
                    accuracy_pct=5.0)  # fmt: skip
    assert_agrees(pressed, kept, force, pulse)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_ball_over_an_artery_is_as_on_two_meshes_of_calculix() -> None:
    """Hexahedra of our own deck, and where it is there the shared reference's wedges."""
    kept = json.loads((FOLDER / "TIHA-ball.json").read_text("utf-8"))
    scene = Scene.model_validate(kept["scene"])
    pressed = press(scene, 32.0, kept["depth_mm"], kept["pressures_mmhg"], accuracy_pct=5.0)
    assert pressed.model == "solid"
    assert pressed.error_estimate_pct < 5.0
    assert_agrees(pressed, kept, force=0.005, pulse=0.02)
    if (shared := SHARED / "reference" / "solid" / "TIHA-ball.json").is_file():
        assert_agrees(pressed, json.loads(shared.read_text("utf-8"))[-1], force=0.005, pulse=0.02)


def assert_agrees(pressed: Press, solved: dict[str, Any], force: float, pulse: float) -> None:
    """Forces, and their changes from one pressure to the next, within shares ``force`` and
    ``pulse`` at the pressures that CalculiX was asked for."""
    force_n = {s.pressure_mmhg: s.force_n for s in pressed.states}
    ours = np.array([force_n[p] for p in solved["pressures_mmhg"]])
    np.testing.assert_allclose(ours, solved["force_n"], rtol=force)
    np.testing.assert_allclose(np.diff(ours), np.diff(solved["force_n"]), rtol=pulse)
