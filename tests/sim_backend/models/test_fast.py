"""The fast model answers within what it states, however narrow what lies beneath."""

import numpy as np
import pytest
from small_block import BLOCK

from sim_backend.models import fast
from sim_backend.models.fast import FastModel, fast_model
from sim_backend.models.place import place
from sim_backend.models.response import OutOfRange
from sim_backend.scene.scene_file import Scene, SceneError, load_scene
from sim_backend.scene.waves import PA_PER_MMHG

BEAT_PA = np.array([80.0, 120.0]) * PA_PER_MMHG


@pytest.fixture(scope="module")
def model() -> FastModel:
    return fast_model(BLOCK, 1.0)


def test_force_and_pulse_of_presses_lie_within_what_is_stated(model: FastModel) -> None:
    rng = np.random.default_rng(3)
    for _ in range(3):
        at = float(rng.uniform(*model.range.x_m)), float(rng.uniform(0.3e-3, 1e-3))
        pressed = place(BLOCK, at[0]).solve(at[1], BEAT_PA.tolist(), accuracy_pct=0.3)
        ours = model.force_n(*at, BEAT_PA)
        assert (np.abs(ours - pressed.force_n) < model.error_n(*at, BEAT_PA)).all()
        assert (model.error_n(*at, BEAT_PA) < 0.05 * ours).all()
        stated_n = float(model.pulse_error_n(*at, *BEAT_PA))
        assert abs(np.ptp(ours) - np.ptp(pressed.force_n)) < stated_n < 0.15 * np.ptp(ours)


def test_a_mirrored_place_feels_the_same(model: FastModel) -> None:
    left, right = model.force_n(np.array([7.3e-3, 16.7e-3]), 8e-4, 1.2e4)
    assert left == pytest.approx(right, rel=1e-9)


def test_stations_are_met_and_nothing_beyond_the_places_is_said(model: FastModel) -> None:
    station = model.stations[2]
    at = station.x_m, 0.8e-3, BEAT_PA
    assert model.force_n(*at) == pytest.approx(station.force_n(*at), rel=1e-12)
    assert model.von_mises_pa(*at) == pytest.approx(station.von_mises_pa(*at), rel=1e-12)
    with pytest.raises(OutOfRange, match="place of 1 mm"):
        model.force_n(1e-3, 0.8e-3, 1.2e4)


@pytest.mark.parametrize("x_mm", [10.9, 20.3, 33.3])
def test_a_bump_narrower_than_the_finger_is_known(x_mm: float) -> None:
    """A lump of 0.6 mm, 0.15 mm below the surface: 16 % more force over 1 mm."""
    scene = Scene.model_validate({
        "name": "bump", "plane": "strain", "indenter": {"shape": "cylinder", "radius_mm": 0.7},
        "tissue": {"width_mm": 44.0, "height_mm": 8.0, "modulus_kpa": 50.0, "poisson": 0.45},
        "inclusion": [{"kind": "tumour", "x_mm": x_mm, "depth_mm": 0.45, "diameter_mm": 0.6,
                       "modulus_kpa": 1000.0, "poisson": 0.45}]})  # fmt: skip
    model = fast_model(scene, 0.3)
    for away_mm in (0.13, -0.37, 0.71):
        at = 1e-3 * (x_mm + away_mm), 0.25e-3
        force = place(scene, at[0]).solve(at[1], accuracy_pct=0.5).force_n[0]
        assert abs(model.force_n(*at, 0.0) / force - 1) < model.error_n(*at, 0.0) / force < 0.03


def test_what_too_few_places_leave_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fast, "MOST_PLACES", 8)
    rough = fast_model(BLOCK, 0.9)
    assert rough.off[0] > fast.OFF_SHARE[0] * rough.stations[0].left.rest


@pytest.mark.parametrize("max_depth_mm", [0.0, 0.001, 100.0, float("nan")])
def test_a_depth_that_cannot_be_meant_is_refused(max_depth_mm: float) -> None:
    with pytest.raises(SceneError, match="max_depth_mm"):
        fast_model(BLOCK, max_depth_mm)


def test_a_lone_vessel_is_refused() -> None:
    with pytest.raises(SceneError, match="over its middle only"):
        fast_model(load_scene("HAOT"), 1.0)
