"""Every finger shape by its outline: what contact, decks and pictures ask of it agree."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backend.scene.indenter import (
    SHAPES,
    Cone,
    Cylinder,
    Flat,
    Indenter,
    Punch,
    Sphere,
    Wedge,
)  # fmt: skip
from sim_backend.scene.scene_file import Scene, SceneError

EXAMPLES: list[Indenter] = [
    Cylinder(radius_mm=5),
    Cylinder(radius_mm=5, edge_radius_mm=1, axis="across"),
    Flat(shape="flat", width_mm=8, edge_radius_mm=0.5),
    Sphere(shape="sphere", radius_mm=3),
    Punch(shape="flat", diameter_mm=8, edge_radius_mm=1),
    Wedge(shape="wedge", angle_deg=90, tip_radius_mm=0.5, width_mm=10),
    Wedge(shape="wedge", angle_deg=150, tip_radius_mm=2, width_mm=8),
    Cone(shape="cone", angle_deg=60, tip_radius_mm=0.3, diameter_mm=6),
]
each_finger = pytest.mark.parametrize("finger", EXAMPLES, ids=lambda one: one.tag)


def test_each_shape_of_the_scene_file_is_looked_at() -> None:
    assert {type(one) for one in EXAMPLES} == set(SHAPES)


@each_finger
def test_the_outline_has_no_gap_and_is_as_wide_as_the_chord(finger: Indenter) -> None:
    profile = finger.profile
    x, y = profile.outline().T
    gap, normal, _ = profile.gap(np.abs(x), y)
    np.testing.assert_allclose(gap, 0, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*normal.T), 1)
    assert y.min() == 0
    assert (np.diff(x) > 0).all()
    np.testing.assert_allclose(x, -x[::-1], atol=1e-15)
    assert 2e3 * profile.half_width == pytest.approx(finger.width_mm_projected)
    for at, height in zip(x[x > 0], y[x > 0], strict=True):
        if height > 1e-9:
            assert profile.chord(height) == pytest.approx(at, rel=1e-9)
    length = np.hypot(np.diff(x), np.diff(y)).sum() / 2
    assert profile.arc(y[-1]) == pytest.approx(length, rel=1e-3)
    assert profile.chord(1.0) == pytest.approx(profile.half_width)


@each_finger
@given(r=st.floats(0, 7e-3), h=st.floats(-4e-3, 9e-3))
def test_gap_gradient_and_curvature_by_differences(finger: Indenter, r: float, h: float) -> None:
    """Outside the core, but for the lines where another part of the outline becomes the nearest."""
    profile, step = finger.profile, 1e-7
    places = np.array([(r, h), (r + step, h), (r - step, h), (r, h + step), (r, h - step)])
    gap, slope, curvature = profile.gap(np.abs(places[:, 0]), places[:, 1])
    if r < 2 * step or gap[0] < -0.9 * profile.radius or np.ptp(curvature) > 1e-3 * curvature[0]:
        return
    by_r, by_h = (gap[1] - gap[2]) / (2 * step), (gap[3] - gap[4]) / (2 * step)
    np.testing.assert_allclose(slope[0], [by_r, by_h], atol=1e-5)
    along = np.array([slope[0, 1], -slope[0, 0]])
    turned = along[0] * (slope[1] - slope[2]) + along[1] * (slope[3] - slope[4])
    assert turned @ along / (2 * step) == pytest.approx(curvature[0], rel=1e-3, abs=1e-2)


def test_a_wedge_rises_at_its_angle() -> None:
    profile = Wedge(shape="wedge", angle_deg=90, tip_radius_mm=0.5, width_mm=10).profile
    assert profile.chord(3e-3) - profile.chord(2e-3) == pytest.approx(1e-3)
    sharp = 0.5e-3 * (np.sqrt(2) - 1)  # from the rounded point up to where the flanks would meet
    assert profile.chord(2e-3) == pytest.approx(2e-3 + sharp)


BLOCK = {"width_mm": 40.0, "height_mm": 20.0, "modulus_kpa": 50.0, "poisson": 0.49}


@pytest.mark.parametrize("finger", EXAMPLES, ids=lambda one: one.tag)
def test_a_finger_is_known_in_the_scenes_that_it_says(finger: Indenter) -> None:
    for plane in ("strain", "solid"):
        tissue = BLOCK | ({"length_mm": 40.0} if plane == "solid" else {})
        keys = finger.model_dump()
        if isinstance(finger, Cylinder) and plane == "strain":
            keys = {"radius_mm": finger.radius_mm}
        elif isinstance(finger, Cylinder):
            keys |= {"edge_radius_mm": 1.0}
        raw = {"name": "any", "plane": plane, "tissue": tissue, "indenter": keys}
        if plane in finger.planes:
            assert type(Scene.model_validate(raw).indenter) is type(finger)
        else:
            with pytest.raises((ValueError, SceneError), match="indenter"):
                Scene.model_validate(raw)


def test_a_point_as_wide_as_the_finger_is_refused() -> None:
    with pytest.raises(ValueError, match="tip_radius_mm = 5 must be below half of width_mm, 4"):
        Wedge(shape="wedge", angle_deg=90, tip_radius_mm=5, width_mm=8)
    with pytest.raises(ValueError, match="angle_deg"):
        Cone(shape="cone", angle_deg=180, tip_radius_mm=0.5, diameter_mm=8)
