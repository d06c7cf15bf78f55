"""Every force model says the same of the same press, within the errors that it states."""

import numpy as np
import pytest
from small_block import BLOCK

from sim_backend.models.response import OutOfRange, StationResponse
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import load_scene
from sim_backend.scene.waves import PA_PER_MMHG
from tests.support.full_model import FullModel

ForceModel = FullModel | StationResponse
X_M, DEPTH_M = 7e-3, 8e-4
LOW_PA, HIGH_PA = BLOCK.pulse.diastolic_mmhg * PA_PER_MMHG, BLOCK.pulse.systolic_mmhg * PA_PER_MMHG


@pytest.fixture(scope="module", params=["full model", "station response"])
def model(request: pytest.FixtureRequest) -> ForceModel:
    if request.param == "full model":
        return FullModel(BLOCK, X_M)
    return respond(BLOCK, X_M, 1e-3)


@pytest.fixture(scope="module")
def truth() -> FullModel:
    """Presses twice as accurate as any of the others claims to be."""
    return FullModel(BLOCK, X_M, accuracy_pct=0.2)


def test_force_and_pulse_are_those_of_accurate_presses(model: ForceModel, truth: FullModel) -> None:
    at = DEPTH_M, np.array([LOW_PA, HIGH_PA])
    off = np.abs(model.force_n(*at) - truth.force_n(*at))
    assert (off <= model.error_n(*at) + truth.error_n(*at)).all()
    assert (model.error_n(*at) < 0.05 * truth.force_n(*at)).all()  # an error, not an excuse
    pulse = np.ptp(truth.force_n(*at))
    stated = float(model.pulse_error_n(DEPTH_M, LOW_PA, HIGH_PA))
    theirs = float(truth.pulse_error_n(DEPTH_M, LOW_PA, HIGH_PA))
    assert abs(np.ptp(model.force_n(*at)) - pulse) <= stated + theirs
    assert stated < 0.15 * pulse


def test_the_whole_range_is_answered_and_nothing_beyond_its_depth(model: ForceModel) -> None:
    known = model.range
    assert np.isfinite(model.force_n(DEPTH_M, [LOW_PA, HIGH_PA])).all()
    assert model.force_n(np.full((2, 3), DEPTH_M), LOW_PA).shape == (2, 3)
    with pytest.raises(OutOfRange, match="depth of"):
        model.error_n(2 * known.depth_m[1], LOW_PA)
    with pytest.raises(OutOfRange, match="depth of nan"):
        model.error_n(np.nan, LOW_PA)


def test_a_mirrored_station_knows_its_own_place() -> None:
    scene = load_scene("TI")
    left, right = respond(scene, 20e-3, 1e-3), respond(scene, 44e-3, 1e-3)
    assert left.force_n(1e-3, 0.0) == right.force_n(1e-3, 0.0) > 0
    assert (left.x_m, right.x_m) == (20e-3, 44e-3)


@pytest.mark.parametrize("name", ["TI", "TIHA"])
def test_depths_and_pressures_broadcast(name: str) -> None:
    station = respond(load_scene(name), 28e-3, 1e-3)
    depth_m, pressure_pa = np.array([[-1e-3], [0.4e-3], [1e-3]]), np.array([LOW_PA, HIGH_PA])
    for answer in (station.force_n, station.von_mises_pa, station.error_n):
        table = answer(depth_m, pressure_pa)
        assert table.shape == (3, 2)
        assert table[1, 1] == answer(0.4e-3, HIGH_PA)
