"""The words of a press that has no equilibrium."""

from dataclasses import replace

import pytest
from small_block import BLOCK

from sim_backend import load_scene
from sim_backend.fem.continuation import unloaded
from sim_backend.fem.limits import physical_limit
from sim_backend.fem.model import build_section
from sim_backend.fem.newton import Load, NotConverged, SkinPressedFlat
from sim_backend.scene.scene_file import Scene

FILLED_PA = 12e3


@pytest.mark.parametrize("failure", [NotConverged("crushed"), SkinPressedFlat("pressed flat")])
@pytest.mark.parametrize("scene", [BLOCK, load_scene("HAOT")], ids=lambda one: one.name)
def test_a_refusal_names_no_negative_depth(scene: Scene, failure: NotConverged) -> None:
    """Vessels are filled with the finger in the air; the way down may end before it touches."""
    x_m = 1e-3 * scene.inclusion[0].x_mm
    section = build_section(scene, x_m, depth_m=1e-3, size_m=0.5e-3)
    goal = Load(1e-3, FILLED_PA)

    def said(depth_m: float) -> str:
        last = replace(unloaded(section), load=Load(depth_m, FILLED_PA))
        return str(physical_limit(section, last, goal, failure))

    assert "found no equilibrium deeper than 0.3 mm" in said(0.3e-3)
    assert "found no equilibrium once the finger touches" in said(-0.1153e-3)
    assert "-0.1" not in said(-0.1153e-3)
