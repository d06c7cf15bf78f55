"""Against presses in nearly incompressible plane strain that another method solved on other meshes:
displacements and pressures as separate fields (the table says what made it)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import best_element
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.waves import PA_PER_MMHG

TABLE = json.loads(
    (Path(__file__).parents[2] / "data" / "presses" / "taylor-hood.json").read_text("utf-8")
)
FORCE, PULSE = 0.005, 0.01


@pytest.mark.parametrize("row", TABLE["presses"], ids=lambda row: f"nu {row['poisson']}")
def test_force_and_pulse_are_those_of_two_fields(row: dict[str, Any]) -> None:
    """At 0.5 mm, where ours differs by 0.4 % of the force and 0.5 % of the pulse."""
    raw = load_scene(TABLE["scene"]).model_dump() | {"plane": TABLE["plane"]}
    for solid in (raw["tissue"], *raw["inclusion"]):
        solid["poisson"] = row["poisson"]
    scene = Scene.model_validate(raw)
    assert best_element(scene) == ("Q4M" if row["poisson"] > 0.495 else "T6")
    levels = [p * PA_PER_MMHG for p in row["pressures_mmhg"]]
    _, found = solve_finite(scene, 1e-3 * TABLE["x_mm"], 1e-3 * TABLE["depth_mm"], levels, 0.5e-3)
    ours = 1e-3 * np.array([one.force_n_per_m for one in found])
    theirs = np.array(row["force_n_per_mm"])
    np.testing.assert_allclose(ours, theirs, rtol=FORCE)
    np.testing.assert_allclose(np.diff(ours)[-1], np.diff(theirs)[-1], rtol=PULSE)
