"""Every force model says the same of the same press, within the errors that it states."""

import numpy as np
import pytest
from small_block import BLOCK

from sim_backend.models import fast as fast_module
from sim_backend.models.fast import FastModel, fast_model
from sim_backend.models.place import place
from sim_backend.models.response import OutOfRange, StationResponse
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import Scene, SceneError, load_scene
from sim_backend.scene.waves import PA_PER_MMHG
from tests.support.full_model import FullModel

ForceModel = FullModel | StationResponse | FastModel
X_M, DEPTH_M = 7e-3, 8e-4
LOW_PA, HIGH_PA = BLOCK.pulse.diastolic_mmhg * PA_PER_MMHG, BLOCK.pulse.systolic_mmhg * PA_PER_MMHG


@pytest.fixture(scope="module")
def fast() -> FastModel:
    return fast_model(BLOCK, 1.0)


@pytest.fixture(scope="module", params=["full model", "station response", "fast model"])
def model(request: pytest.FixtureRequest, fast: FastModel) -> ForceModel:
    match request.param:
        case "full model":
            return FullModel(BLOCK, accuracy_pct=1.0)
        case "station response":
            return respond(BLOCK, X_M, 1e-3)
    return fast


@pytest.fixture(scope="module")
def truth() -> FullModel:
    """Presses twice as accurate as any of the others claims to be."""
    return FullModel(BLOCK, accuracy_pct=0.2)


def test_force_and_pulse_are_those_of_accurate_presses(model: ForceModel, truth: FullModel) -> None:
    at = X_M, DEPTH_M, np.array([LOW_PA, HIGH_PA])
    off = np.abs(model.force_n(*at) - truth.force_n(*at))
    assert (off <= model.error_n(*at) + truth.error_n(*at)).all()
    assert (model.error_n(*at) < 0.05 * truth.force_n(*at)).all()  # an error, not an excuse
    pulse = np.ptp(truth.force_n(*at))
    stated = float(model.pulse_error_n(X_M, DEPTH_M, LOW_PA, HIGH_PA))
    theirs = float(truth.pulse_error_n(X_M, DEPTH_M, LOW_PA, HIGH_PA))
    assert abs(np.ptp(model.force_n(*at)) - pulse) <= stated + theirs
    assert stated < 0.15 * pulse


def test_the_whole_range_is_answered_and_nothing_beyond_its_depth(model: ForceModel) -> None:
    known = model.range
    assert known.x_m[0] <= X_M <= known.x_m[1]
    assert np.isfinite(model.force_n(X_M, DEPTH_M, [LOW_PA, HIGH_PA])).all()
    assert model.force_n(X_M, np.full((2, 3), DEPTH_M), LOW_PA).shape == (2, 3)
    with pytest.raises(OutOfRange, match="depth of"):
        model.error_n(X_M, 2 * known.depth_m[1], LOW_PA)
    with pytest.raises(OutOfRange, match="depth of nan"):
        model.error_n(X_M, np.nan, LOW_PA)


def test_a_mirrored_station_knows_its_own_place() -> None:
    scene = load_scene("TI")
    left, right = respond(scene, 20e-3, 1e-3), respond(scene, 44e-3, 1e-3)
    assert left.force_n(20e-3, 1e-3, 0.0) == right.force_n(44e-3, 1e-3, 0.0) > 0
    with pytest.raises(OutOfRange, match="place of 20 mm"):
        right.force_n(20e-3, 1e-3, 0.0)


BEAT_PA = np.array([80.0, 120.0]) * PA_PER_MMHG


def test_force_and_pulse_of_presses_lie_within_what_is_stated(fast: FastModel) -> None:
    rng = np.random.default_rng(3)
    for _ in range(3):
        at = float(rng.uniform(*fast.range.x_m)), float(rng.uniform(0.3e-3, 1e-3))
        pressed = place(BLOCK, at[0]).solve(at[1], BEAT_PA.tolist(), accuracy_pct=0.3)
        ours = fast.force_n(*at, BEAT_PA)
        assert (np.abs(ours - pressed.force_n) < fast.error_n(*at, BEAT_PA)).all()
        assert (fast.error_n(*at, BEAT_PA) < 0.05 * ours).all()
        stated_n = float(fast.pulse_error_n(*at, *BEAT_PA))
        assert abs(np.ptp(ours) - np.ptp(pressed.force_n)) < stated_n < 0.15 * np.ptp(ours)


def test_a_mirrored_place_feels_the_same(fast: FastModel) -> None:
    left, right = fast.force_n(np.array([7.3e-3, 16.7e-3]), 8e-4, 1.2e4)
    assert left == pytest.approx(right, rel=1e-9)


def test_stations_are_met_and_nothing_beyond_the_places_is_said(fast: FastModel) -> None:
    station = fast.stations[2]
    at = station.x_m, 0.8e-3, BEAT_PA
    assert fast.force_n(*at) == pytest.approx(station.force_n(*at), rel=1e-12)
    assert fast.von_mises_pa(*at) == pytest.approx(station.von_mises_pa(*at), rel=1e-12)
    with pytest.raises(OutOfRange, match="place of 1 mm"):
        fast.force_n(1e-3, 0.8e-3, 1.2e4)


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
    monkeypatch.setattr(fast_module, "MOST_PLACES", 8)
    rough = fast_model(BLOCK, 0.93)  # which no other test asks for: models are kept
    assert rough.off[0] > fast_module.OFF_SHARE[0] * rough.stations[0].left.rest


@pytest.mark.parametrize("max_depth_mm", [0.0, 0.001, 100.0, float("nan")])
def test_a_depth_that_cannot_be_meant_is_refused(max_depth_mm: float) -> None:
    with pytest.raises(SceneError, match="max_depth_mm"):
        fast_model(BLOCK, max_depth_mm)


def test_a_lone_vessel_is_refused() -> None:
    with pytest.raises(SceneError, match="over its middle only"):
        fast_model(load_scene("HAOT"), 1.0)
