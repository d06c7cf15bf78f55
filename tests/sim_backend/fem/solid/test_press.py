"""Presses into solids against the plane section and the body of revolution."""

import numpy as np
import pytest
from small_solid import small_solid

from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.solid.build import grading_of
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.slicing import section_at
from sim_backend.scene.waves import PA_PER_MMHG

ARTERY = {"kind": "artery", "x_mm": 12.0, "depth_mm": 6.5, "inner_diameter_mm": 4.5,
          "wall_mm": 0.63, "modulus_kpa": 400.0, "poisson": 0.45}  # fmt: skip
TISSUE = {"width_mm": 24.0, "height_mm": 12.0, "modulus_kpa": 50.0, "poisson": 0.45}


def test_a_long_finger_on_a_held_block_is_plane_strain() -> None:
    """Same triangles, so that nothing but the third dimension could make a difference."""
    finger = {"shape": "cylinder", "radius_mm": 5.0, "length_mm": 40.0}
    solid = Scene.model_validate(
        {"name": "long", "plane": "solid", "inclusion": [ARTERY],
         "tissue": {**TISSUE, "length_mm": 4.0, "ends": "held"},
         "indenter": {**finger, "edge_radius_mm": 0.5}}
    )  # fmt: skip
    flat = Scene.model_validate(
        {"name": "flat", "plane": "strain", "inclusion": [ARTERY], "tissue": TISSUE,
         "indenter": finger}
    )  # fmt: skip
    levels = [0.0, 100 * PA_PER_MMHG]
    _, solved = solve_solid(solid, 12e-3, 1e-3, levels, 1.5e-3)
    grading = grading_of(solid, 1.5e-3)
    _, plane = solve_finite(flat, 12e-3, 1e-3, levels, 1.5e-3, "T6", grading=grading)
    space = np.array([s.force_n for s in solved])
    section = np.array([4e-3 * s.force_n_per_m for s in plane])
    np.testing.assert_allclose(space, section, rtol=1e-3)
    assert np.ptp(space) == pytest.approx(np.ptp(section), rel=5e-3)


def test_a_press_off_the_middle_is_the_same_on_either_side() -> None:
    """Then nothing is symmetric, and the block is fixed on average only."""
    scene = small_solid(24.0, 20.0, height_mm=12.0)
    forces = [
        solve_solid(section_at(scene, z_mm), x, 0.3e-3, [0.0], 2.5e-3)[1][0].force_n
        for x, z_mm in ((9e-3, 2.0), (15e-3, -2.0))
    ]
    assert forces[0] == pytest.approx(forces[1], rel=0.02)  # the meshes are no mirror images


def test_a_punch_that_leans_presses_as_one_that_stands_as_deep_in_the_middle() -> None:
    """All of its face in contact, what turning adds on one side it takes from the other."""
    lean_deg, depth_m, edge_m, radius_m = 2.0, 0.5e-3, 0.5e-3, 2.0e-3
    lean = np.radians(lean_deg)
    above_m = edge_m * (1 - np.cos(lean)) + (radius_m - edge_m) * np.sin(lean)

    def force_n(tilt_deg: float | None, depth_m: float) -> float:
        punch = {"shape": "flat", "diameter_mm": 2e3 * radius_m, "edge_radius_mm": 1e3 * edge_m,
                 "tilt_deg": tilt_deg}  # fmt: skip
        scene = small_solid(20.0, 16.0, indenter=punch)
        return solve_solid(scene, 10e-3, depth_m, [0.0], 1e-3)[1][0].force_n

    upright_n = force_n(None, depth_m - above_m)
    assert force_n(lean_deg, depth_m) == pytest.approx(upright_n, rel=0.003)
    assert force_n(-lean_deg, depth_m) == pytest.approx(upright_n, rel=0.003)
    assert force_n(None, depth_m) > 1.05 * upright_n
