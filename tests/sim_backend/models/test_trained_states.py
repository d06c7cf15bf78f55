"""The fast model of a solid: what is solved for it, and what it makes of that along the vessel."""

import logging
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small_solid import small_solid, vessel

from sim_backend.models import (
    kept_tables,
    second_process,
    solid_response,
    station_response,
    trained_states,
)
from sim_backend.models import surrogate as fast
from sim_backend.models.response import levels_pa
from sim_backend.models.surrogate import surrogate
from sim_backend.models.trained_states import states
from sim_backend.scene.scene_file import Scene

LUMP = {"kind": "tumour", "x_mm": 9.0, "depth_mm": 4.0, "z_mm": 2.0, "diameter_mm": 2.0,
        "modulus_kpa": 500.0, "poisson": 0.45}  # fmt: skip
PLAIN = small_solid(14.0, 20.0)
OVER_VESSEL = small_solid(14.0, 20.0, vessel(7.0))
OVER_LUMP = small_solid(14.0, 20.0, LUMP)
DEEPEST_MM = 0.6


def imagined_n(
    scene: Scene, x_m: float, depth_m: np.ndarray, pressure_pa: np.ndarray
) -> np.ndarray:
    """A force that the ends lower, that a vessel's pressure raises, and a lump near the finger."""
    tissue = scene.tissue
    assert tissue is not None and tissue.length_mm is not None
    ends_mm = tissue.length_mm / 2 + np.array([-1, 1]) * (tissue.z_mm or 0.0)
    force = 5e3 * depth_m**1.5 * (1 - 0.3 * np.exp(-3.2 * ends_mm / tissue.height_mm).sum())
    for one in scene.inclusion:
        away_mm = np.hypot(1e3 * x_m - one.x_mm, getattr(one, "z_mm", None) or 0.0)
        swell = 1e-5 * pressure_pa if one.kind == "artery" else 0.2
        force = force * (1 + swell * np.exp(-((away_mm / 4.0) ** 2)))
    return np.asarray(force + 0.0 * pressure_pa)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[tuple[Scene, float]]:
    """What was solved, in imagination, of scenes and places."""
    found: list[tuple[Scene, float]] = []

    def respond(scene: Scene, x_m: float, _depth_m: float) -> SimpleNamespace:
        found.append((scene, x_m))

        def force(at_m: float, depth_m: np.ndarray, pressure_pa: np.ndarray) -> np.ndarray:
            return imagined_n(scene, at_m, depth_m, pressure_pa)

        return SimpleNamespace(force_n=force, von_mises_pa=lambda *at: 1e3 * force(*at))

    def truth(
        scene: Scene, x_m: float, z_m: float, depth_m: float, beats: np.ndarray, finer: bool
    ) -> np.ndarray:  # fmt: skip
        assert finer
        there = trained_states.section_at(scene, 1e3 * z_m)
        force = np.mean([imagined_n(one, x_m, np.array(depth_m), beats)
                         for one in solid_response.symmetric_parts(there)], axis=0)  # fmt: skip
        return np.stack([force, 1e3 * force], axis=-1)

    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: tmp_path)
    monkeypatch.setattr(second_process, "processors", lambda: 1)
    monkeypatch.setattr(solid_response, "respond_solid", respond)
    monkeypatch.setattr(fast, "states", truth)
    monkeypatch.setattr(trained_states, "VALIDATION_STATES", 40)
    fast._known.cache_clear()
    return found


@pytest.mark.usefixtures("asked")
@pytest.mark.parametrize("scene", [OVER_VESSEL, OVER_LUMP], ids=["vessel", "lump"])
def test_between_the_places_solved_force_and_pulse_are_reported(scene: Scene) -> None:
    model = surrogate(scene, DEEPEST_MM)
    # 20 random states were within half of it
    assert (model.force_error_pct, model.pulse_error_pct) == (5.0, 5.0)
    for z_m in (-2.2e-3, 0.4e-3, 2.0e-3):
        x_m, depth_m, (_, *ends) = 8.1e-3, 0.43e-3, levels_pa(scene)
        force = model.force_n(x_m, depth_m, ends, z_m)
        there = trained_states.section_at(scene, 1e3 * z_m)
        truth = imagined_n(there, x_m, np.array(depth_m), np.array(ends))
        assert force == pytest.approx(truth, rel=5e-3)
        assert np.ptp(force) == pytest.approx(np.ptp(truth), rel=0.03, abs=1e-12)
        assert 1e3 * force == pytest.approx(model.von_mises_pa(x_m, depth_m, ends, z_m))


def test_of_a_straight_block_few_symmetric_ones_on_one_side_are_solved(
    asked: list[tuple[Scene, float]],
) -> None:
    model = surrogate(OVER_VESSEL, DEEPEST_MM)
    lengths = {one.tissue and one.tissue.length_mm for one, _ in asked}
    assert len(lengths) == trained_states.ENDS
    assert {OVER_VESSEL.tissue and OVER_VESSEL.tissue.length_mm} < lengths  # as scans keep it
    assert max(x_m for _, x_m in asked) == pytest.approx(7e-3)
    assert len(asked) == len(set(asked)) + 1  # the first, which is timed, is on disk in earnest
    here = model.force_n(5e-3, 5e-4, 12e3, 3e-3)
    images = model.force_n([9e-3, 5e-3, 9e-3], 5e-4, 12e3, [3e-3, -3e-3, -3e-3])
    assert images == pytest.approx(np.full(3, here), rel=1e-9)


def test_a_lump_is_felt_where_it_lies(asked: list[tuple[Scene, float]]) -> None:
    model = surrogate(OVER_LUMP, DEEPEST_MM)
    assert model.range.z_m == pytest.approx((-3.6e-3, 3.6e-3))
    there, aside, other_way = model.force_n([9e-3, 5e-3, 9e-3], 5e-4, 0.0, [2e-3, 2e-3, -2e-3])
    assert there > 1.1 * aside
    assert there > 1.1 * other_way
    lumps = [(one.inclusion[0], x_m) for one, x_m in asked]
    along_mm = {round(abs(getattr(lump, "z_mm", 0.0)), 6) for lump, _ in lumps}
    across_mm = {round(abs(1e3 * x_m - lump.x_mm), 6) for lump, x_m in lumps}
    for away_mm in (sorted(along_mm), sorted(across_mm)):
        assert away_mm[0] == 0.0
        assert away_mm[1] < 1.4  # a quarter of its depth, and a little more


def test_training_that_takes_long_says_so(
    asked: list[tuple[Scene, float]],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(trained_states, "LONG_S", 0.0)
    monkeypatch.setattr(logging.getLogger("palpate"), "propagate", True)
    surrogate(OVER_VESSEL, DEEPEST_MM)
    (said,) = caplog.messages
    assert said.startswith(f"the fast model of small solves {len(set(asked)) - 1} more places")


def test_a_solid_s_fast_model_is_its_presses_and_is_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Against presses on the next finer mesh, at places, ends and depths that were not solved."""
    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: tmp_path)
    monkeypatch.setattr(second_process, "processors", lambda: 1)
    monkeypatch.setattr(station_response, "_kept", {})
    for name, value in (("VALIDATION_STATES", 2), ("ENDS", 3)):
        monkeypatch.setattr(trained_states, name, value)
    fast._known.cache_clear()
    model = surrogate(PLAIN, DEEPEST_MM)
    assert 5.0 <= model.force_error_pct < 8.0
    for x_m, z_m, depth_m in ((5.9e-3, 2.9e-3, 0.5e-3), (8.3e-3, -1.1e-3, 0.28e-3)):
        truth = states(PLAIN, x_m, z_m, depth_m, np.zeros(1), finer=True)[0, 0]
        stated = model.error_n(x_m, depth_m, 0.0, z_m)
        assert abs(model.force_n(x_m, depth_m, 0.0, z_m) - truth) <= stated
    beyond = float(model.force_n(7e-3, 0.5e-3, 0.0, 5e-3))
    alone = states(PLAIN, 7e-3, 5e-3, 0.5e-3, np.zeros(1), finer=False)[0, 0]
    assert beyond == pytest.approx(alone)
    assert model.force_n(7e-3, 0.0, 0.0, 5e-3) == 0.0

    def solve_place(*_: object) -> dict[str, np.ndarray]:
        raise AssertionError("solved again")

    monkeypatch.setattr(solid_response, "solve_place", solve_place)
    fast._known.cache_clear()
    assert surrogate(PLAIN, DEEPEST_MM).force_n(5.9e-3, 5e-4, 0.0) > 0
    fast._known.cache_clear()
