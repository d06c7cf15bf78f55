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
FORCE, PULSE = 0.02, 0.05


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("ball-over-ball", "axisymmetric"),
        ("cylinder-with-ends", "solid"),
        ("part-length-stenosis", "solid"),
    ],
)
def test_force_and_pulse_are_calculix_s(name: str, model: str) -> None:
    kept = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    scene = Scene.model_validate(kept["scene"])
    pressed = press(scene, 32.0, kept["depth_mm"], kept["pressures_mmhg"], model=model,
                    accuracy_pct=5.0)  # fmt: skip
    agree(pressed, kept)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_ball_over_an_artery_is_as_on_two_meshes_of_calculix() -> None:
    """Hexahedra of our own deck, and where it is there the shared reference's wedges."""
    kept = json.loads((FOLDER / "TIHA-ball.json").read_text("utf-8"))
    scene = Scene.model_validate(kept["scene"])
    pressed = press(scene, 32.0, kept["depth_mm"], (0.0, *kept["pressures_mmhg"]), accuracy_pct=5.0)
    assert pressed.model == "solid"
    assert pressed.error_estimate_pct < 5.0
    agree(pressed, kept)
    if (shared := SHARED / "reference" / "solid" / "TIHA-ball.json").is_file():
        agree(pressed, json.loads(shared.read_text("utf-8"))[-1])


def agree(pressed: Press, solved: dict[str, Any]) -> None:
    """Forces and the pulse at the pressures that CalculiX was asked for."""
    force_n = {s.pressure_mmhg: s.force_n for s in pressed.states}
    ours = np.array([force_n[p] for p in solved["pressures_mmhg"]])
    np.testing.assert_allclose(ours, solved["force_n"], rtol=FORCE)
    np.testing.assert_allclose(np.diff(ours), np.diff(solved["force_n"]), rtol=PULSE)
