"""How deep, how large, how stiff: intervals that hold, and silence where nothing is known."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate
from palpate import Recording, Station
from probe.detection.beneath.grid_sizes import narrowed_sizes
from probe.detection.beneath.hypotheses import Bodies, Likelihood
from probe.detection.beneath.known import known_block
from probe.detection.beneath.narrowing import TwoRows
from probe.detection.beneath.posterior import laplace
from probe.detection.beneath.weighed import weighed
from probe.detection.priors import priors_of
from probe.detection.pulse.presses import presses_of
from probe.storage.run import recording_of
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG, load_wave
from sim_backend.touch.kinds import LUMP, Kind


def scanned(scene: Scene, folder: Path, noise_mn: float = 0.5) -> palpate.Finding:
    rig = palpate.default_rig(scene)
    quiet = rig.sensor[0].model_copy(update={"noise_mn": noise_mn})
    rig = rig.model_copy(update={"sensor": (quiet,)})
    run = palpate.scan(rig, scene=scene, seed=3, out=folder)
    return palpate.detect(run.path)


def test_a_lump_s_depth_and_diameter_hold_and_its_stiffness_is_bounded(tmp_path: Path) -> None:
    (lump,) = scanned(palpate.load_scene("TIT"), tmp_path).objects
    low_m, high_m = lump.sizes.depth_ci_m
    assert low_m < 12.66e-3 < high_m and high_m - low_m < 5e-3
    low_m, high_m = lump.sizes.diameter_ci_m
    assert low_m < 4.5e-3 < high_m and high_m - low_m < 2.5e-3
    low_pa, high_pa = lump.sizes.modulus_ci_pa
    assert low_pa < 1000e3 < high_pa
    said = lump.sizes.as_json()
    assert said["depth_mm"] == pytest.approx(1e3 * lump.sizes.depth_m)
    assert said["modulus_ci_kpa"][1] is None or said["modulus_ci_kpa"][1] > 1000


def test_a_lump_that_grew_is_larger_in_diameter_and_as_deep(tmp_path: Path) -> None:
    lump = palpate.load_scene("TIT")
    (small,) = lump.inclusion
    large = lump.model_copy(update={"inclusion": (small.model_copy(update={"diameter_mm": 6.5}),)})
    runs = []
    for scene, folder in ((lump, tmp_path / "first"), (large, tmp_path / "later")):
        palpate.scan(palpate.default_rig(scene), scene, folder, seed=1)
        runs += folder.glob("*.run")
    said = palpate.compare(*runs)
    _, low, high = said.objects[0].change["diameter"]
    assert low <= 6.5 / 4.5 - 1 <= high and low > 0
    _, shallower, deeper = said.objects[0].change["depth"]
    assert shallower <= 0 <= deeper
    assert "larger or harder in B" in said.reason and "mm in B" in said.reason


def test_a_vessel_s_depth_holds_and_its_narrowing_is_not_told(tmp_path: Path) -> None:
    (vessel,) = scanned(palpate.load_scene("TIHA"), tmp_path).objects
    low_m, high_m = vessel.sizes.depth_ci_m
    assert np.isnan(low_m) or low_m < 12.66e-3 < high_m
    assert "stenosis" in vessel.sizes.undecided
    assert vessel.sizes.as_json()["stenosis"] is None


def two_in(scene: Scene, first: dict[str, float], other: Scene, second: dict[str, float]) -> Scene:
    """The block of ``scene`` with its body and that of another scene, moved."""
    bodies = (
        scene.inclusion[0].model_copy(update=first), other.inclusion[0].model_copy(update=second),
    )  # fmt: skip
    return scene.model_copy(update={"name": "two", "inclusion": bodies})


def recorded_over(scenes: Sequence[Scene], noise_n: float = 0.5e-3) -> Recording:
    """A row of 15 presses, 4 mm apart, over each of some scenes, by a touch table."""
    rng, t, stations = np.random.default_rng(2), np.arange(0, 4.5, 0.01), []
    ramp_m, face_m2 = 2.5e-3 * np.clip(t - 0.5, 0, 1), 1e-4
    for j, scene in enumerate(scenes):
        touch, wave = (
            palpate.touch(scene),
            load_wave(scene.pulse.model_copy(update={"wave": "brachial"})),
        )
        beat_mmhg = wave.pressure_pa(1.2 * t) / PA_PER_MMHG
        for i in range(15):
            force_n = touch.force_n(4.0 * (i + 1), 1e3 * ramp_m, beat_mmhg)
            signal = (force_n + noise_n * rng.normal(size=len(t))) / face_m2
            stations.append(Station(
                15 * j + i, 4e-3 * (i + 1), 4e-3 * j, t, signal[:, None],
                np.zeros((len(t), 1), bool), 0.5, 1.5, 4.5, ramp_m,
            ))  # fmt: skip
    block = scenes[0].model_dump(mode="json", exclude={"name", "inclusion", "pulse"})
    return Recording(tuple(stations), ("force",), ("force",), face_m2, block=block)


def narrowed(fraction: float) -> Scene:
    """TISA with another narrowing, or open."""
    scene = palpate.load_scene("TISA")
    (vessel,) = scene.inclusion
    assert isinstance(vessel, Artery) and vessel.stenosis is not None
    stenosis = vessel.stenosis.model_copy(update={"fraction": fraction}) if fraction else None
    return scene.model_copy(
        update={"inclusion": (vessel.model_copy(update={"stenosis": stenosis}),)}
    )


def test_a_row_over_the_open_vessel_tells_how_narrow_it_is_in_another() -> None:
    found = palpate.detect(recorded_over([narrowed(0.0), narrowed(0.0), narrowed(0.4)]))
    (vessel,) = found.objects
    assert vessel.kind == "stenotic artery" and vessel.stenosed_m == (8e-3, 8e-3)
    low, high = vessel.sizes.stenosis_ci
    assert 0.1 < low < 0.4 < high
    assert vessel.sizes.depth_ci_m[0] < 12.66e-3 < vessel.sizes.depth_ci_m[1]
    assert vessel.sizes.diameter_ci_m[0] < 4.5e-3 < vessel.sizes.diameter_ci_m[1]
    said = vessel.sizes.as_json()
    assert said["stenosis_ci"][0] == low and "stenosis" not in said["undecided"]
    assert f"stenosis above {100 * low:.0f} %" in repr(found)


def test_a_row_whose_first_press_met_nothing_is_a_row() -> None:
    """A robot comes back to a row's y to within micrometres only."""
    scan = recorded_over([narrowed(0.0), narrowed(0.0), narrowed(0.4)])
    lost = scan.stations[30]
    missed = replace(
        lost, y_m=lost.y_m + 3e-6, signal_pa=lost.signal_pa - lost.signal_pa.mean(axis=0),
        saturated=np.ones_like(lost.saturated),
    )  # fmt: skip
    stations = (*scan.stations[:30], missed, *scan.stations[31:])
    (vessel,) = palpate.detect(replace(scan, stations=stations)).objects
    assert vessel.kind == "stenotic artery" and vessel.sizes.stenosis_ci[0] > 0.1


def test_two_rows_at_a_block_s_side_have_no_room_for_a_vessel() -> None:
    recording = recorded_over([narrowed(0.0)])
    known, presses = known_block(recording), presses_of(recording, 0.005)
    assert not isinstance(known, str)
    aside = [
        replace(press, station=replace(press.station, x_m=58e-3 + 0.3e-3 * n))
        for n, press in enumerate(presses)
    ]
    row = known.row(aside)
    assert not isinstance(row, str)
    said = narrowed_sizes(TwoRows(row, row))
    assert said.undecided["stenosis"] == "the row has no room for it"


def test_over_a_grid_a_lump_is_known_by_the_row_that_shows_it_best() -> None:
    lump, bare = palpate.load_scene("TIT"), palpate.load_scene("TI")
    (found,) = palpate.detect(recorded_over([bare, lump, bare])).objects
    low_m, high_m = found.sizes.depth_ci_m
    assert low_m < 12.66e-3 < high_m and high_m - low_m < 5e-3


BENCH = """
diastolic_mmhg = [78.0, 82.0]  # by a cuff
pulse_pressure_mmhg = [38.0, 42.0]
tilt_mm_per_m = 2.0            # a granite table
bow_mm = 0.01
height_mm = 0.01
repeatability_mm = 0.002
relaxation = 0.05              # silicone
"""


def test_what_is_known_of_heart_and_bench_narrows_the_sizes_of_a_vessel(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    scan = recorded_over([palpate.load_scene("TIHA")])
    by_default, by_bench = (
        palpate.detect(scan),
        palpate.detect(scan, priors=tmp_path / "bench.toml"),
    )
    (any_rig,), (this_rig,) = by_default.objects, by_bench.objects
    low_m, high_m = this_rig.sizes.diameter_ci_m
    assert low_m < 4.5e-3 < high_m and high_m - low_m < 0.9 * np.ptp(any_rig.sizes.diameter_ci_m)
    assert this_rig.sizes.modulus_ci_pa[1] > 400e3
    assert by_bench.as_json()["priors"]["diastolic_mmhg"] == [78.0, 82.0]


@pytest.mark.parametrize(
    ("text", "said"),
    [("diastolic_mmhg = [90.0, 80.0]", "the lower end comes first"), ("cuff = 1", "cuff"),
     ("tissue_kpa = [0, 5]", "tissue_kpa")],
)  # fmt: skip
def test_a_file_of_priors_that_cannot_be_is_refused_by_its_key(
    tmp_path: Path, text: str, said: str
) -> None:
    file = tmp_path / "priors.toml"
    file.write_text(text)
    with pytest.raises(palpate.ConfigError, match=f"priors.toml: .*{said}"):
        priors_of(file)


def test_a_twin_presses_back_as_what_was_scanned() -> None:
    lump = palpate.load_scene("TIT")
    twin = palpate.twin(recorded_over([lump]))
    x_mm = np.arange(4.0, 61.0, 4.0)
    true_n, its_n = (palpate.touch(scene).force_n(x_mm, 2.5) for scene in (lump, twin))
    np.testing.assert_allclose(its_n, true_n, rtol=0.02)
    assert [body.kind for body in twin.inclusion] == ["tumour"]


def test_a_healthy_twin_is_open_and_what_is_not_known_has_none() -> None:
    (vessel,) = palpate.twin(recorded_over([palpate.load_scene("TIHA")])).inclusion
    assert isinstance(vessel, Artery) and vessel.stenosis is None
    with pytest.raises(palpate.SceneError, match="nothing lies there"):
        palpate.twin(recorded_over([palpate.load_scene("TI")]))
    with pytest.raises(palpate.SceneError, match="several rows"):
        palpate.twin(recorded_over([narrowed(0.0), narrowed(0.4)]))


def test_each_of_two_lumps_has_its_depth(tmp_path: Path) -> None:
    lump = palpate.load_scene("TIT")
    there = {"depth_mm": 8.0}
    found = scanned(two_in(lump, {"x_mm": 25.0, **there}, lump, {"x_mm": 39.0, **there}), tmp_path)
    assert [one.kind for one in found.objects] == ["tumour", "tumour"]
    for one in found.objects:
        low_m, high_m = one.sizes.depth_ci_m
        assert low_m < 8e-3 < high_m and high_m - low_m < 5e-3
        low_m, high_m = one.sizes.diameter_ci_m
        assert low_m < 4.5e-3 < high_m


def test_a_lump_beside_an_artery_is_no_healthy_one(tmp_path: Path) -> None:
    """Its own pulse may hide in the artery's, and only how it presses back tells it from a narrowed
    vessel."""
    vessel, lump = palpate.load_scene("TIHA"), palpate.load_scene("TIT")
    scene = two_in(lump, {"x_mm": 25.0, "depth_mm": 8.0}, vessel, {"x_mm": 39.0, "depth_mm": 11.0})
    still, beating = scanned(scene, tmp_path).objects
    assert beating.kind == "artery" and max(still.chances, key=still.chances.get) == "tumour"
    assert still.chances["artery"] < 0.1 and still.chances["nothing"] < 0.01


def test_two_lumps_nearer_than_bumps_part_are_two(tmp_path: Path) -> None:
    lump, there = palpate.load_scene("TIT"), {"depth_mm": 8.0}
    scene = two_in(lump, {"x_mm": 26.0, **there}, lump, {"x_mm": 36.0, **there})
    found = scanned(scene, tmp_path).objects
    assert [round(one.position_mm) for one in found] == [26, 36]
    assert all(one.sizes.depth_ci_m[0] < 8e-3 < one.sizes.depth_ci_m[1] for one in found)


def test_a_row_that_no_body_explains_names_none() -> None:
    """Every second press is a third firmer."""
    scan = recorded_over([palpate.load_scene("TI")])
    stations = tuple(
        replace(each, signal_pa=each.signal_pa * (1.3 if each.index % 2 else 1.0))
        for each in scan.stations
    )
    found = palpate.detect(replace(scan, stations=stations))
    assert found.finding in ("undecided", "nothing"), found
    assert all(np.isnan(one.sizes.depth_m) for one in found.objects)


def test_few_presses_are_weighed_and_one_or_two_are_not(tmp_path: Path) -> None:
    scene = palpate.load_scene("TIHA")
    run = palpate.scan(palpate.default_rig(scene), scene, tmp_path, seed=3)
    whole = recording_of(run.path)
    for stations in ([7], [6, 8], [2, 7, 12]):
        few = replace(whole, stations=tuple(whole.stations[n] for n in stations))
        found = palpate.detect(few)
        (vessel,) = found.objects
        known = np.isfinite(vessel.sizes.depth_ci_m).any()
        assert known == (len(stations) >= 3), vessel.sizes
        if len(stations) >= 3:
            assert (found.finding, vessel.reason) == ("artery", "")
            assert vessel.position_ci_m[0] < 32e-3 < vessel.position_ci_m[1]
        else:
            assert "a row of at least 3 stations" in vessel.sizes.undecided["depth"]
        aborted = palpate.detect(replace(few, finish="aborted"))
        assert aborted.finding in ("undecided", "artery")


@pytest.mark.parametrize("kinds", [(), (LUMP,)])
def test_a_tilted_and_wavy_surface_is_no_body_and_hides_none(
    kinds: tuple[Kind, ...], tmp_path: Path
) -> None:
    """Forces of the table at depths that differ by up to 0.17 mm from place to place, with waves of
    0.06 mm rms."""
    scene = palpate.load_scene("TI")
    run = palpate.scan(palpate.default_rig(scene), scene, tmp_path, seed=3)
    recording = recording_of(run.path)
    known = known_block(recording)
    assert not isinstance(known, str)
    row = known.row(presses_of(recording, 0.005))
    assert not isinstance(row, str)
    x_m = row.data.x_m - row.data.x_m.mean()
    height_m = 3e-3 * x_m + 85e-6 * np.sin(2 * np.pi * x_m / 16e-3)
    force_n = np.empty_like(row.data.force_n)
    for k, sunk in enumerate(row.sunk):
        deep = sunk + height_m / row.half_width_m
        force_n[:, k] = 50e3 * row.area_m2 * row.table.bare_force(row.x, deep, row.block)
    bodies = Bodies(kinds)
    of = dict.fromkeys(bodies.names, 0.0) | {
        "0.depth": 1.8, "0.log_diameter": 0.3, "0.log_ratio": np.log(20)
    }  # fmt: skip
    theta = np.array([[of[name] for name in bodies.names]])
    force_n *= 1 + row.added(bodies, theta, row.x)[0, ..., 0]
    data = replace(row.data, force_n=force_n, force_sd_n=np.full_like(force_n, 5e-4))
    said = weighed(Likelihood(data, known.table, known.scene))
    assert said is not None and said.chances[bodies] > 0.9, said and said.chances


def test_one_table_knows_blocks_and_fingers_of_any_size(tmp_path: Path) -> None:
    scene = palpate.load_scene("TIT")
    (lump,) = scene.inclusion
    assert scene.tissue is not None
    scene = scene.model_copy(update={
        "inclusion": (lump.model_copy(update={"depth_mm": 9.0, "diameter_mm": 5.0}),),
        "tissue": scene.tissue.model_copy(update={"height_mm": 21.0, "modulus_kpa": 30.0}),
        "indenter": scene.indenter.model_copy(update={"radius_mm": 6.0}),
    })  # fmt: skip
    (found,) = scanned(scene, tmp_path).objects
    low_m, high_m = found.sizes.depth_ci_m
    assert low_m < 9e-3 < high_m and high_m - low_m < 4e-3
    low_m, high_m = found.sizes.diameter_ci_m
    assert low_m < 5e-3 < high_m


@pytest.mark.parametrize(
    ("table", "update", "said"),
    [
        ("support", {"contact": "bonded"}, "no table for this finger on this support"),
        ("tissue", {"height_mm": 60.0}, "flatter, higher, narrower or wider"),
    ],
)
def test_what_no_table_knows_has_no_sizes(
    tmp_path: Path, table: str, update: dict[str, Any], said: str
) -> None:
    scene = palpate.load_scene("TIT")
    other = scene.model_copy(update={table: getattr(scene, table).model_copy(update=update)})
    for one in scanned(other, tmp_path).objects:
        assert said in one.sizes.undecided["depth"]
        assert np.isnan(one.sizes.depth_m) and one.sizes.as_json()["depth_ci_mm"] is None


def test_one_press_that_goes_deeper_than_the_stage_knows_is_no_body() -> None:
    """Its forces are 4 % too large along the whole ramp, its neighbours' are not."""
    scan = recorded_over([palpate.load_scene("TI")])
    stations = tuple(
        replace(each, signal_pa=each.signal_pa * (1.04 if each.index == 4 else 1.0))
        for each in scan.stations
    )
    found = palpate.detect(replace(scan, stations=stations))
    assert found.finding in ("nothing", "undecided"), found


def test_a_pulse_that_noise_would_hide_keeps_a_lump_from_its_name() -> None:
    quiet, noisy = (
        palpate.detect(recorded_over([palpate.load_scene("TIT")], noise_n))
        for noise_n in (0.1e-3, 20e-3)
    )
    assert quiet.finding == "tumour"
    assert noisy.finding in ("undecided", "cannot see"), noisy


def test_a_row_scanned_from_right_to_left_says_the_same() -> None:
    """Near the block's side, where the bare block is softer than in its middle."""
    (lump,) = palpate.load_scene("TIT").inclusion
    moved = lump.model_copy(update={"x_mm": 9.0, "depth_mm": 8.0})
    scan = recorded_over([palpate.load_scene("TIT").model_copy(update={"inclusion": (moved,)})])
    back = tuple(replace(each, index=14 - each.index) for each in reversed(scan.stations))
    (one,), (other,) = (
        palpate.detect(each).objects for each in (scan, replace(scan, stations=back))
    )
    assert one.kind == other.kind == "tumour"
    assert other.peak_pa == pytest.approx(one.peak_pa, rel=0.01)


def test_a_body_under_a_first_station_that_is_pressed_twice_is_known() -> None:
    scan = recorded_over([palpate.load_scene("TIT")])
    twice = tuple(replace(each, index=2 * n + k) for n, each in enumerate(scan.stations)
                  for k in (0, 1))  # fmt: skip
    known, presses = known_block(scan), presses_of(replace(scan, stations=twice), 0.005)
    assert not isinstance(known, str)
    row = known.row(presses)
    assert not isinstance(row, str)
    lump = Bodies((LUMP,))
    at_first = laplace(row.model(lump)).alone()
    at_first.points[0, lump.column(0, "x")] = row.x[0]
    assert np.isfinite(row.over(lump, 0, at_first)).all()


def test_a_pulse_that_no_press_shows_may_be_there_all_the_same(tmp_path: Path) -> None:
    """TISA's of 2.5 mN, in noise of 3 mN: no press is sure of it."""
    scene = palpate.load_scene("TISA")
    rig = palpate.default_rig(scene)
    noisy = rig.sensor[0].model_copy(update={"noise_mn": 3.0})
    rig = rig.model_copy(update={"sensor": (noisy,)})
    (found,) = palpate.detect(palpate.scan(rig, scene, tmp_path, seed=2).path).objects
    assert found.kind == "undecided" and found.chances["stenotic artery"] > 0.2
