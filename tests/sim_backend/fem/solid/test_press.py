"""Fingers in space, and their presses against the plane section and the body of revolution."""

import numpy as np
import pytest
from scipy.optimize import brentq
from small_solid import small_solid

from sim_backend.arrays import Array
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.solid.build import grading_of
from sim_backend.fem.solid.finger import solid_finger
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.scene.indenter import Cone, Cylinder, Indenter, Punch, Sphere
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


PLACE = np.array([32e-3, 16e-3, 0.0])
FINGERS = [
    Sphere(shape="sphere", radius_mm=5),
    Cylinder(edge_radius_mm=1, axis="along"),
    Cylinder(edge_radius_mm=1, axis="across"),
    Punch(shape="flat", diameter_mm=8, edge_radius_mm=1),
    Cone(shape="cone", angle_deg=120, tip_radius_mm=1, diameter_mm=10),
]


LEANING = [
    Cylinder(edge_radius_mm=1, axis="across", tilt_deg=20),
    Punch(shape="flat", diameter_mm=8, edge_radius_mm=1, tilt_deg=-10),
]


@pytest.mark.parametrize("finger", [*FINGERS, *LEANING], ids=lambda f: f.shape)
def test_the_lowest_point_touches_the_surface(finger: Indenter) -> None:
    side = 1e-3 * np.linspace(-8, 8, 321)
    x, z = np.meshgrid(side, side[140:181])
    surface = PLACE + np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1)
    gap, _, _ = solid_finger(finger, 32e-3, 16e-3).gap(surface)
    assert gap.min() == pytest.approx(0.0, abs=1e-6)
    if finger in FINGERS:
        touching = surface[gap < 1e-9].mean(axis=0)
        np.testing.assert_allclose(touching, PLACE, atol=1e-6)


@pytest.mark.parametrize("finger", LEANING, ids=lambda f: f.shape)
def test_a_finger_leans_about_the_middle_of_its_underside(finger: Indenter) -> None:
    lean = np.radians(finger.leaning_deg)
    body = solid_finger(finger, *PLACE[:2])

    def above(height_m: float) -> Array:
        return np.array([PLACE[0], PLACE[1] + height_m, 0.0])

    middle = above(brentq(lambda h: body.gap(above(h)[None])[0][0], 0.0, 4e-3))
    level = np.array([np.cos(lean), -np.sin(lean), 0.0])
    under = middle + np.outer([-2.5e-3, 1e-3, 2.5e-3], level)
    np.testing.assert_allclose(body.gap(under)[0], 0.0, atol=1e-9)
    assert np.sign(body.up[0]) == np.sign(lean)


@pytest.mark.parametrize("finger", [*FINGERS, *LEANING], ids=lambda f: f.shape)
def test_gradient_and_hessian_by_differences(finger: Indenter) -> None:
    body = solid_finger(finger, 32e-3, 16e-3)
    rng = np.random.default_rng(0)
    points = PLACE + 1e-3 * rng.uniform(-8, 8, (400, 3))
    points = points[body.gap(points)[0] > -0.8 * body.profile.radius]
    _, normal, hessian = body.gap(points)
    for a in range(3):
        step = np.zeros(3)
        step[a] = 1e-8
        (ahead, n_ahead, _), (behind, n_behind, _) = (body.gap(points + s * step) for s in (1, -1))
        off = np.abs((ahead - behind) / 2e-8 - normal[:, a])
        turned = np.abs((n_ahead - n_behind) / 2e-8 - hessian[:, :, a]).max(axis=1)
        assert np.quantile(off, 0.98) < 1e-6  # a few points lie where side and end meet
        assert np.quantile(turned, 0.97) < 1e-2  # of 1000 / m


def test_a_capsule_as_short_as_it_is_thick_is_a_ball() -> None:
    ball = solid_finger(Sphere(shape="sphere", radius_mm=5), *PLACE[:2])
    capsule = solid_finger(Cylinder(radius_mm=5, length_mm=10, edge_radius_mm=5), *PLACE[:2])
    points = PLACE + 1e-3 * np.random.default_rng(0).uniform(-4, 4, (50, 3))
    np.testing.assert_allclose(ball.gap(points)[0], capsule.gap(points)[0])
