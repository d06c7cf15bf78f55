"""Solids against presses that CalculiX solved on hexahedra of its own, kept with their decks
(`benchmarks/calculix_solids.py` made them)."""

import json
from pathlib import Path

import numpy as np
import pytest

from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene

FOLDER = Path(__file__).parents[3] / "data" / "presses"
FORCE, PULSE = 0.02, 0.05


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("ball-over-ball", "axisymmetric"),
        ("TIHA-ball", "solid"),
        ("cylinder-with-ends", "solid"),
        ("part-length-stenosis", "solid"),
    ],
)
def test_force_and_pulse_are_calculix_s(name: str, model: str) -> None:
    kept = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    scene = Scene.model_validate(kept["scene"])
    pressed = press(scene, 32.0, kept["depth_mm"], kept["pressures_mmhg"], model=model,
                    accuracy_pct=5.0)  # fmt: skip
    ours, theirs = np.array([s.force_n for s in pressed.states]), np.array(kept["force_n"])
    np.testing.assert_allclose(ours, theirs, rtol=FORCE)
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), rtol=PULSE)
