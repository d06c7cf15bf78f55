"""The fast model answers within what it states, and outside its range the full model answers."""

from pathlib import Path

import numpy as np
import pytest
from small_block import BLOCK

from sim_backend.fem.finite_strain import solve_finite
from sim_backend.models import kept_tables, second_process, trained_states
from sim_backend.models import surrogate as fast
from sim_backend.models.plane_response import element_size_m
from sim_backend.models.surrogate import Surrogate, cache_file, surrogate
from sim_backend.scene.scene_file import Scene, SceneError, load_scene
from sim_backend.scene.waves import PA_PER_MMHG


@pytest.fixture
def model(small_surrogate: Surrogate) -> Surrogate:
    return small_surrogate


def solved_n(scene: Scene, x_m: float, depth_m: float, mmhg: tuple[float, ...]) -> np.ndarray:
    levels = [p * PA_PER_MMHG for p in mmhg]
    _, found = solve_finite(scene, x_m, depth_m, levels, element_size_m(scene))
    return 1e-3 * scene.indenter.length_mm * np.array([s.force_n_per_m for s in found])


def test_force_and_pulse_are_within_what_is_stated(model: Surrogate) -> None:
    assert 0 < model.force_error_pct < 1
    assert 0 < model.pulse_error_pct < 5
    rng = np.random.default_rng(3)
    for _ in range(3):
        x, depth = float(rng.uniform(*model.range.x_m)), float(rng.uniform(*model.range.depth_m))
        truth = solved_n(BLOCK, x, depth, (80.0, 120.0))
        ours = model.force_n(x, depth, np.array([80.0, 120.0]) * PA_PER_MMHG)
        assert ours == pytest.approx(truth, rel=0.01)
        assert np.ptp(ours) == pytest.approx(np.ptp(truth), rel=0.03)


def test_outside_its_range_the_full_model_answers(model: Surrogate) -> None:
    x, deeper = float(np.mean(model.range.x_m)), 1.2 * model.range.depth_m[1]
    pressure = 100 * PA_PER_MMHG
    answer = model.force_n(x, np.array([0.0, deeper, model.range.depth_m[1]]), pressure)
    assert answer[0] == 0.0
    assert answer[1] == pytest.approx(solved_n(BLOCK, x, deeper, (100.0,))[0], rel=0.005)
    assert answer[2] < answer[1]
    nearly = model.force_n(x, model.range.depth_m[1] * (1 + 1e-6), pressure)
    assert nearly == pytest.approx(answer[2], rel=0.01)  # no jump where the two meet


def test_a_mirrored_place_feels_the_same(model: Surrogate) -> None:
    middle = float(np.mean(model.range.x_m))
    aside = 0.8 * (model.range.x_m[1] - middle)
    left, right = model.force_n(np.array([middle - aside, middle + aside]), 8e-4, 1e4)
    assert left == pytest.approx(right, rel=2e-3)


def test_the_cache_goes_by_content_and_a_torn_file_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: Surrogate
) -> None:
    renamed = BLOCK.model_copy(update={"name": "another"})
    thicker = BLOCK.inclusion[0].model_copy(update={"wall_mm": 0.7})
    other = BLOCK.model_copy(update={"inclusion": (thicker,)})
    assert cache_file(renamed, 1e-3) == cache_file(BLOCK, 1e-3)
    assert len({cache_file(BLOCK, 1e-3), cache_file(BLOCK, 2e-3), cache_file(other, 1e-3)}) == 3
    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: tmp_path)
    path = cache_file(BLOCK, 1e-3)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"PK\x03\x04 cut short")
    trained = []

    def train(_scene: Scene, max_depth_m: float) -> dict[str, np.ndarray]:
        trained.append(max_depth_m)
        x, depth = np.linspace(*model.range.x_m, 9), np.geomspace(*model.range.depth_m, 7)
        solved = 1 + np.ones((9, 1, 7, 3, 2)) * depth[:, None, None]
        return {"x": x, "z": np.zeros(1), "depth": depth, "pressure": np.linspace(0, 2e4, 3),
                "solved": solved, "errors": np.ones(2)}  # fmt: skip

    monkeypatch.setattr(fast, "train", train)
    fast._known.cache_clear()
    first = surrogate(BLOCK, 1.0).force_n(model.range.x_m[0], 5e-4, 1e4)
    fast._known.cache_clear()
    assert surrogate(BLOCK, 1.0).force_n(model.range.x_m[0], 5e-4, 1e4) == first
    assert trained == [1e-3]  # the second came from the disk
    fast._known.cache_clear()


def over_a_small_lump(
    x_mm: float, depth_mm: float = 0.45, diameter_mm: float = 0.6, height_mm: float = 8.0
) -> Scene:
    """A lump just below the surface, under a thin finger."""
    lump = {"kind": "tumour", "x_mm": x_mm, "depth_mm": depth_mm, "diameter_mm": diameter_mm,
            "modulus_kpa": 1000.0, "poisson": 0.49}  # fmt: skip
    block = {"width_mm": 64.0, "height_mm": height_mm, "modulus_kpa": 50.0, "poisson": 0.49}
    finger = {"shape": "cylinder", "radius_mm": 0.7}
    tables = {"tissue": block, "inclusion": [lump], "indenter": finger}
    return Scene.model_validate({"name": "bump", "plane": "strain"} | tables)


def bump_n(scene: Scene, x_m: float, depth_m: np.ndarray | float) -> np.ndarray:
    """What finite elements say there within 2 %: 16 % more over the lump, 1 mm wide."""
    away_mm = 1e3 * x_m - scene.inclusion[0].x_mm
    return np.asarray(270.0 * np.asarray(depth_m) * (1 + 0.16 * np.exp(-((away_mm / 0.5) ** 2))))


@pytest.fixture
def imagined(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Sections that are not solved: `bump_n`."""

    def column(scene: Scene, x_m: float, depth: np.ndarray, *_rest: object) -> np.ndarray:
        return np.repeat(bump_n(scene, x_m, depth)[:, None, None], 2, axis=2)

    def truth(scene: Scene, x_m: float, _z_m: float, depth_m: float, *_rest: object) -> np.ndarray:
        return np.full((1, 2), bump_n(scene, x_m, depth_m))

    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: tmp_path)
    monkeypatch.setattr(second_process, "processors", lambda: 1)
    monkeypatch.setattr(trained_states, "section_column", column)
    monkeypatch.setattr(fast, "states", truth)
    fast._known.cache_clear()


def off_pct(scene: Scene, model: Surrogate) -> float:
    """The largest error over the lump and near it."""
    x_m = 1e-3 * (scene.inclusion[0].x_mm + np.linspace(-1.5, 1.5, 61))
    ours = model.force_n(x_m, 0.45e-3, 0.0)
    truth = np.array([bump_n(scene, float(x), 0.45e-3) for x in x_m])
    return float(100 * np.abs(ours / truth - 1).max())


LUMPS_MM = (10.9, 20.3, 33.3, 40.9)
"""Where the fast model had been off by 11, 16, 13 and 1 times what it stated."""


@pytest.mark.usefixtures("imagined")
@pytest.mark.parametrize("x_mm", LUMPS_MM)
def test_a_bump_narrower_than_the_usual_step_is_known(x_mm: float) -> None:
    scene = over_a_small_lump(x_mm)
    model = surrogate(scene, 0.5)
    assert off_pct(scene, model) < model.force_error_pct < 1.0


@pytest.mark.usefixtures("imagined")
@pytest.mark.parametrize("x_mm", LUMPS_MM)
def test_a_bump_between_the_places_is_in_the_stated_error(
    x_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the distances of places elsewhere, the validation states would see the bump."""
    monkeypatch.setattr(trained_states, "BUMP_SHARE", 1e3, raising=False)
    scene = over_a_small_lump(x_mm)
    model = surrogate(scene, 0.5)
    assert 3.0 < off_pct(scene, model) < model.force_error_pct


@pytest.mark.parametrize(("depth_mm", "diameter_mm"), [(0.151, 0.3), (5.001, 10.0)])
def test_places_over_the_narrowest_bumps_stay_few(depth_mm: float, diameter_mm: float) -> None:
    thick = over_a_small_lump(20.3, depth_mm, diameter_mm, height_mm=16.0)
    x_m = trained_states.places(thick, 0.5e-3)
    assert 100 < len(x_m) <= trained_states.MOST_PLACES
    assert np.diff(x_m).min() < 0.05e-3


def test_places_over_the_paper_s_vessel_are_as_far_apart_as_before() -> None:
    x_m = trained_states.places(load_scene("TIHA"), 2.5e-3)
    assert len(x_m) == 31
    assert np.diff(x_m).min() == pytest.approx(1.25e-3)


@pytest.mark.parametrize("max_depth_mm", [0.0, 0.2, 100.0, float("nan")])
def test_a_depth_that_cannot_be_meant_is_refused(max_depth_mm: float) -> None:
    with pytest.raises(SceneError, match="max_depth_mm"):
        surrogate(BLOCK, max_depth_mm)


def test_a_lone_vessel_is_refused() -> None:
    with pytest.raises(SceneError, match="over its middle only"):
        surrogate(load_scene("HAOT"), 1.0)
