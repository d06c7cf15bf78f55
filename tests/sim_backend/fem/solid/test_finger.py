"""Fingers in space: where they end, and how their gap changes."""

import numpy as np
import pytest
from scipy.optimize import brentq

from sim_backend.arrays import Array
from sim_backend.fem.solid.finger import solid_finger
from sim_backend.scene.indenter import Cone, Cylinder, Indenter, Punch, Sphere

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
    """Which stays over the place, while its top goes towards larger x."""
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
