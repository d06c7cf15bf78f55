"""Newton's method in solids: its way, not only its end."""

import pytest

from sim_backend.fem.newton import Load
from sim_backend.fem.solid.build import build_body
from sim_backend.fem.solid.newton import equilibrium, unloaded
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.scene.scene_file import Scene

SCENE = Scene.model_validate(
    {"name": "block", "plane": "solid",
     "tissue": {"width_mm": 24.0, "height_mm": 12.0, "length_mm": 20.0, "modulus_kpa": 50.0,
                "poisson": 0.49},
     "indenter": {"shape": "sphere", "radius_mm": 5.0}}
)  # fmt: skip


def test_a_deep_first_touch_takes_few_steps() -> None:
    """Springs of the first gap are forty times the contact force: they must turn no normals."""
    body = build_body(SCENE, 12e-3, depth_m=1e-3, size_m=1.6e-3)
    found = equilibrium(body, body.solver(), unloaded(body), Load(0.35e-3, 0.0))
    assert found.iterations <= 6


def test_a_finer_mesh_begins_where_the_coarser_one_ended() -> None:
    coarse = solve_solid(SCENE, 12e-3, 0.6e-3, [0.0], 2.5e-3)
    _, (anew,) = solve_solid(SCENE, 12e-3, 0.6e-3, [0.0], 2.0e-3)
    _, (carried,) = solve_solid(SCENE, 12e-3, 0.6e-3, [0.0], 2.0e-3, coarser=coarse)
    assert carried.force_n == pytest.approx(anew.force_n, rel=1e-5)
    assert carried.iterations <= 6
    assert carried.stable is True
