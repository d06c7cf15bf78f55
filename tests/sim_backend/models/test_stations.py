"""What the phantom feels of a solid: the states that are solved, and what lies between them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_solid import small_solid, vessel

from sim_backend.fem.newton import CannotSolve, Solution, Unstable
from sim_backend.fem.solid.build import half_width_m
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.fem.solid.stress import under_finger_pa
from sim_backend.models import bodies, kept_tables, station_response, stations
from sim_backend.models.response import Station, levels_pa
from sim_backend.models.solid_meshes import SHARES
from sim_backend.models.station_response import respond, station
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.slicing import section_at
from sim_backend.scene.symmetry import symmetric_parts

DEPTH_M = 0.6e-3
VESSEL = vessel(8.0)
SCENE = small_solid(16.0, 10.0, VESSEL)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def test_a_solid_s_response_is_its_presses(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: cache)
    station_response._kept.clear()
    found = respond(SCENE, 10e-3, DEPTH_M)
    rest, low, high = levels_pa(SCENE)
    # x = 10 mm is the mirror image of 6 mm
    size_m = SHARES[0] * half_width_m(SCENE)
    body, states = solve_solid(SCENE, 6e-3, DEPTH_M, [low, high], size_m)
    ours = found.force_n(np.full(2, DEPTH_M), np.array([low, high]))
    assert ours == pytest.approx([one.force for one in states], rel=1e-4)
    assert found.bulge_m > 0
    depth = np.linspace(-found.bulge_m, DEPTH_M, 40)
    down = found.force_n(depth, np.array(rest))
    assert down[0] == 0.0 and (np.diff(down) > 0).all()
    stress = found.von_mises_pa(np.full(2, DEPTH_M), np.array([low, high]))
    assert stress == pytest.approx(
        [under_finger_pa(body, one.displacement) for one in states], rel=1e-3
    )


def test_a_place_that_was_solved_is_not_solved_again(
    monkeypatch: pytest.MonkeyPatch, cache: Path
) -> None:
    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: cache)
    rest, low, high = levels_pa(SCENE)
    both, sunk = np.array([[1.0], [1e3]]), DEPTH_M * bodies.SOLID_DEPTHS
    over = np.array([low - rest, high - rest])
    powers = np.linalg.solve(np.vander(over, increasing=True), [-0.3, 0.9] / over)
    table = {"sunk": sunk + 1e-4, "values": both * [1.0, 3, 6, 9, 13], "by_depth": both * sunk,
             "powers": both[:, None] * powers[:, None] * np.ones(5), "bulge": np.array(1e-4),
             "flat": np.array(1.0)}  # fmt: skip
    asked = []

    def solve_station(one: Station) -> dict[str, np.ndarray]:
        asked.append(one.x_m)
        return table

    monkeypatch.setattr(stations, "solve_station", solve_station)
    for _ in range(2):
        station_response._kept.clear()
        found = respond(SCENE, 5e-3, DEPTH_M)
        ends = found.force_n(np.full(2, DEPTH_M), np.array([low, high]))
        assert ends == pytest.approx([12.7, 13.9], rel=1e-9)
    assert asked == [5e-3]


def test_between_depths_a_ball_s_force_follows_its_power() -> None:
    sunk = 1e-3 * bodies.SOLID_DEPTHS
    assert stations._slopes_of_powers(sunk, sunk**1.5) == pytest.approx(1.5 * sunk**0.5, rel=1e-9)


def test_a_quarter_of_a_grid_over_what_is_symmetric_both_ways_is_solved() -> None:
    places = [(x_m, z_mm) for z_mm in (-3.0, -1.0, 1.0, 3.0) for x_m in (5e-3, 7e-3, 9e-3, 11e-3)]
    solved = {station(section_at(SCENE, z_mm), x_m, DEPTH_M) for x_m, z_mm in places}
    assert len(solved) == 4
    lump = {"kind": "tumour", "x_mm": 3.0, "depth_mm": 4.0, "z_mm": 2.0, "diameter_mm": 2.0,
            "modulus_kpa": 500.0, "poisson": 0.45}  # fmt: skip
    skew = Scene.model_validate(SCENE.model_dump() | {"inclusion": [VESSEL, lump]})
    assert len({station(section_at(skew, z_mm), x_m, DEPTH_M) for x_m, z_mm in places}) == 16
    path = [(-5.0, 7.0, 4.5), (5.0, 9.0, 4.5)]  # alike if turned by half round the finger
    oblique = Scene.model_validate(SCENE.model_dump() | {"inclusion": [VESSEL | {"path": path}]})
    assert len({station(section_at(oblique, z_mm), x_m, DEPTH_M) for x_m, z_mm in places}) == 8
    row = {station(oblique, x_m, DEPTH_M) for x_m in (5e-3, 7e-3, 9e-3, 11e-3)}
    assert len(row) == 2


def test_a_place_beside_the_middle_is_the_one_on_the_other_side() -> None:
    lump = {"kind": "tumour", "x_mm": 8.0, "depth_mm": 4.5, "diameter_mm": 4.0,
            "modulus_kpa": 500.0, "poisson": 0.45}  # fmt: skip
    scene = Scene.model_validate(SCENE.model_dump() | {"inclusion": [lump]})
    there, here = (
        solve_solid(section_at(scene, z_mm), 7e-3, 0.4e-3, [0.0], 2.4e-3)[1][0].force
        for z_mm in (-1.5, 1.5)
    )
    assert there == pytest.approx(here, rel=1e-6)
    above = solve_solid(scene, 7e-3, 0.4e-3, [0.0], 2.4e-3)[1][0].force
    assert above > 1.002 * here


def test_a_straight_solid_beside_its_middle_is_the_mean_of_two_symmetric_ones(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Against the whole block: 3 mm beside its middle the nearer end takes 2 % of the force."""
    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: tmp_path)
    monkeypatch.setattr(station_response, "_kept", {})
    tissue = {**SCENE.model_dump()["tissue"], "length_mm": 16.0, "width_mm": 14.0}
    plain = Scene.model_validate(SCENE.model_dump() | {"tissue": tissue, "inclusion": []})
    there = section_at(plain, 3.0)
    short, long = symmetric_parts(there)
    assert [one.tissue and one.tissue.length_mm for one in (short, long)] == [10.0, 22.0]
    size_m = SHARES[0] * half_width_m(plain)
    whole = solve_solid(there, 7e-3, DEPTH_M, [0.0], size_m)[1][0].force
    middle = solve_solid(plain, 7e-3, DEPTH_M, [0.0], size_m)[1][0].force
    found = respond(there, 7e-3, DEPTH_M)
    assert found.force_n(DEPTH_M, 0.0) == pytest.approx(whole, rel=4e-3)
    assert whole < 0.985 * middle


def test_what_varies_along_the_vessel_or_ends_under_the_finger_is_solved_as_it_is() -> None:
    ring = {"fraction": 0.3, "modulus_kpa": 2000.0}
    whole = Scene.model_validate(SCENE.model_dump() | {"inclusion": [{**VESSEL, "stenosis": ring}]})
    part = Scene.model_validate(
        SCENE.model_dump() | {"inclusion": [{**VESSEL, "stenosis": {**ring, "z_mm": (-2.0, 2.0)}}]}
    )
    parts = symmetric_parts
    assert parts(SCENE) == [SCENE]
    assert len(parts(section_at(whole, 1.0))) == 2
    assert parts(section_at(part, 1.0)) == [section_at(part, 1.0)]
    assert len(parts(section_at(SCENE, 1.1))) == 1  # 3.9 mm from an end under a ball of 4 mm


def test_far_from_its_ends_a_block_is_felt_alike_everywhere() -> None:
    tissue = {**SCENE.model_dump()["tissue"], "length_mm": 28.0, "width_mm": 14.0}
    scene = Scene.model_validate(SCENE.model_dump() | {"tissue": tissue, "inclusion": []})
    middle, beside = (
        solve_solid(there, 7e-3, DEPTH_M, [0.0], 1.6e-3)[1][0].force
        for there in (scene, section_at(scene, 3.0))
    )
    assert beside == pytest.approx(middle, rel=2e-3)


@pytest.mark.parametrize(("falls_to", "answers"), [(1.02, True), (1.2, False), (None, False)])
def test_what_is_unstable_is_left_where_that_changes_little(
    falls_to: float | None, answers: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = SCENE.model_copy(update={"inclusion": ()})
    here = Station(plain, 8e-3, DEPTH_M)
    before = stations.solve_station(here)["values"]

    def fall(_body: object, one: Solution) -> Solution:
        if falls_to is None:
            raise Unstable("nowhere")
        return replace(one, force=falls_to * one.force)

    monkeypatch.setattr(stations, "judged", lambda _, one: replace(one, stable=False))
    monkeypatch.setattr(stations, "stable_branch", fall)
    if not answers:
        with pytest.raises(CannotSolve, match="unstable"):
            stations.solve_station(here)
        return
    after = stations.solve_station(here)["values"]
    np.testing.assert_array_equal(after[:, :-1], before[:, :-1])
    assert after[0, -1] == pytest.approx(1.02 * before[0, -1])


def test_a_faint_pulse_is_no_better_known_than_its_share_of_the_force(
    monkeypatch: pytest.MonkeyPatch, cache: Path
) -> None:
    monkeypatch.setattr(kept_tables.platformdirs, "user_cache_dir", lambda *_: cache)
    found = respond(SCENE, 10e-3, DEPTH_M)
    _, low, high = levels_pa(SCENE)
    stated_n = found.pulse_error_n(DEPTH_M, low, high)
    forces_n = found.force_n(DEPTH_M, np.array([low, high]))
    clear = replace(found, left=found.left._replace(faint=0.0))
    share_n = clear.pulse_error_n(DEPTH_M, low, high)
    assert share_n >= bodies.SOLID_LEFT.change * np.ptp(forces_n)
    assert stated_n - share_n == pytest.approx(bodies.SOLID_LEFT.faint * forces_n.max())
    assert bodies.SOLID_LEFT.faint * 0.87 > 0.92e-3, "as measured 20 mm beside TIHA's vessel"
    assert found.pulse_error_n(DEPTH_M, low, low) == 0.0
