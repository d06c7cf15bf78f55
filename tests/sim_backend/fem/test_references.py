"""Against presses that CalculiX solved on meshes of its own, where those files are at hand.

CalculiX gives a plane-stress section a finite thickness: 0.6 % stiffer over a vessel.
"""

import json
from typing import Any

import numpy as np
import pytest
from paths import SHARED

from sim_backend.fem.finite_strain import solve_finite
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

FOLDER = SHARED / "reference" / "calculix"
FILES = sorted(FOLDER.glob("*.json"))
FORCE, CHANGE = 0.01, 0.03
NOISE = 3e-4
"""Of the force: what their penalty contact leaves open; TISA's changes are that small."""

if not FILES:
    pytest.skip(f"no reference solutions in {FOLDER}", allow_module_level=True)


def presses() -> list[Any]:
    """One per file and place."""
    return [
        pytest.param(table["scene"], press, id=f"{file.stem}-{press['x_mm']:g}mm")
        for file in FILES
        for table in [json.loads(file.read_text())]
        for press in table["results"]
    ]


@pytest.mark.parametrize(("scene", "press"), presses())
def test_as_calculix(scene, press):
    solid = Scene.model_validate(
        scene
        | {"indenter": scene["indenter"] | {"length_mm": 10.0}}
        | {"pulse": {"wave": "paper", "rate_bpm": 72.0}}
    )
    theirs = np.array(press["force_n_per_mm"])
    levels = [0.0, *(p * PA_PER_MMHG for p in press["pressures_mmhg"])][: len(theirs)]
    _, found = solve_finite(solid, 1e-3 * press["x_mm"], 1e-3 * press["depth_mm"], levels, 0.6e-3)
    ours = 1e-3 * np.array([one.force_n_per_m for one in found])
    np.testing.assert_allclose(ours, theirs, rtol=FORCE)
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), rtol=CHANGE, atol=NOISE * theirs[0])
