"""Solids against presses that CalculiX solved on hexahedra of its own, kept with their decks
(`benchmarks/calculix_solids.py` made them)."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sim_backend.arrays import Array
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene

FOLDER = Path(__file__).parents[3] / "data" / "presses"
VESSELS = ("TIHA-ball", "cylinder-with-ends", "part-length-stenosis")
FORCE, PULSE = 0.02, 0.05
UNEXPLAINED = "8.1 %: CalculiX tells the same pulse on two gradings along z, ours on two meshes"


@cache
def pressed(name: str, model: str) -> tuple[Array, Array]:
    """Our forces [N] and CalculiX'."""
    kept = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    scene = Scene.model_validate(kept["scene"])
    ours = press(scene, 32.0, kept["depth_mm"], kept["pressures_mmhg"], model=model,
                 accuracy_pct=5.0)  # fmt: skip
    return np.array([s.force_n for s in ours.states]), np.array(kept["force_n"])


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("ball-over-ball", "axisymmetric"),
        *((name, "solid") for name in ("ball-over-ball", *VESSELS)),
    ],
)
def test_force_is_calculix_s(name: str, model: str) -> None:
    ours, theirs = pressed(name, model)
    np.testing.assert_allclose(ours, theirs, rtol=FORCE)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.xfail(reason=UNEXPLAINED, strict=True))
        if name == "cylinder-with-ends"
        else name
        for name in VESSELS
    ],
)
def test_pulse_is_calculix_s(name: str) -> None:
    ours, theirs = pressed(name, "solid")
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), rtol=PULSE)
