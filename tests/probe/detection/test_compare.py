"""Two scans compared: by what each shows, wherever tissue and pressure differ."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from known_presses import recording, row, station, wave

from probe.core.recording import Recording, Station
from probe.detection import compare
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

X_M = 1e-3 * np.arange(8.0, 57.0, 4.0)
DEPTH_M = 2.5e-3


def scene(tissue_kpa: float, swing_mmhg: float, inclusion: dict[str, float | str]) -> Scene:
    """A block with one thing in it."""
    return Scene.model_validate({
        "name": "block",
        "tissue": {"width_mm": 64.0, "height_mm": 25.0, "modulus_kpa": tissue_kpa, "poisson": 0.49},
        "inclusion": [{"x_mm": 32.0, "poisson": 0.49} | inclusion],
        "indenter": {"shape": "cylinder", "radius_mm": 5.0},
        "pulse": {"wave": "brachial", "diastolic_mmhg": 80.0, "systolic_mmhg": 80.0 + swing_mmhg},
    })  # fmt: skip


def scanned(seed: int, of: Scene, depth_m: float = DEPTH_M) -> Recording:
    """A row over a solved block, with 0.3 % of scatter from press to press."""
    rng = np.random.default_rng(seed)
    beat_pa = [PA_PER_MMHG * p for p in (of.pulse.diastolic_mmhg, of.pulse.systolic_mmhg)]
    felt = [respond(of, x, depth_m).force_n(depth_m, beat_pa) for x in X_M]
    t = np.arange(500) / 100.0
    stations = []
    for k, (level_n, crest_n) in enumerate(felt):
        beat = (crest_n - level_n) * (wave(1.1 * t + rng.uniform()) + 0.5)
        force_n = level_n * (1 + 0.003 * rng.standard_normal()) + beat
        stress_pa = (force_n + 5e-4 * rng.standard_normal(len(t))) / 1e-4
        stations.append(Station(
            k, float(X_M[k]), 0.0, 10.0 + t, stress_pa[:, None], np.zeros((len(t), 1), dtype=bool),
            9.0, 10.0, 10.0 + t[-1], np.full(len(t), depth_m),
        ))  # fmt: skip
    return recording(stations)


def artery(inner_mm: float, depth_mm: float, **more: object) -> dict[str, object]:
    return {"kind": "artery", "inner_diameter_mm": inner_mm, "wall_mm": inner_mm / 8,
            "modulus_kpa": 400.0, "depth_mm": depth_mm} | more  # fmt: skip


def lump(diameter_mm: float, tissue_kpa: float = 30.0) -> dict[str, object]:
    return {"kind": "tumour", "diameter_mm": diameter_mm, "depth_mm": 8.0,
            "modulus_kpa": 10 * tissue_kpa}  # fmt: skip


@pytest.fixture(scope="module")
def healthy() -> list[Recording]:
    """Healthy arteries that differ in tissue, depth, lumen and pulse pressure."""
    kinds = [(50.0, 40.0, 4.0, 8.0), (65.0, 40.0, 4.0, 12.0), (20.0, 30.0, 3.0, 9.0),
             (35.0, 60.0, 4.5, 13.0)]  # fmt: skip
    return [
        scanned(k, scene(tissue, swing, artery(inner, deep)))
        for k, (tissue, swing, inner, deep) in enumerate(kinds)
    ]


def test_healthy_arteries_are_no_different(healthy: list[Recording]) -> None:
    said = [compare(a, b) for a, b in combinations(healthy, 2)]
    assert [one.diseased for one in said] == ["neither"] * len(said)


def test_a_stenosed_artery_is_named_and_ratios_are_a_over_b(healthy: list[Recording]) -> None:
    stenosis = {"fraction": 0.3, "modulus_kpa": 4000.0}
    sick = scanned(9, scene(50.0, 40.0, artery(4.0, 8.0, stenosis=stenosis)))
    said = compare(healthy[0], sick)
    assert said.diseased == "B"
    assert compare(sick, healthy[0]).diseased == "A"
    assert said.peak_ratio < 1 < said.pulse_ratio
    assert said.objects[0].change["pulse_share"][2] < 0, "its pulse is weaker"


def test_a_lump_that_grew_is_larger_and_one_that_did_not_is_no_different() -> None:
    before = scanned(1, scene(30.0, 40.0, lump(4.5)))
    after = scanned(2, scene(30.0, 40.0, lump(7.0)))
    grown, shrunk, same = (
        compare(a, b) for a, b in ((before, after), (after, before), (after, after))
    )
    value, low, high = grown.objects[0].change["contrast"]
    assert 0 < low < value < high
    assert "larger or harder in B" in grown.reason
    assert "smaller or softer in B" in shrunk.reason
    assert "no different" in same.reason
    for said in (grown, shrunk, same):
        assert said.diseased == "neither", "no vessel, no diseased one"
        assert "hold" not in said.reason
        assert json.loads(json.dumps(said.as_json(), allow_nan=False))["objects"][0]["change_ci"]


def test_a_lump_scanned_again_is_no_different() -> None:
    """Each scan has its own scatter; one in twenty may differ by chance, not two in six."""
    scans = [scanned(k, scene(30.0, 40.0, lump(6.0))) for k in range(4)]
    said = [compare(a, b) for a, b in combinations(scans, 2)]
    assert sum("no different" not in one.reason for one in said) <= 1


def test_kinds_that_differ_are_not_compared(healthy: list[Recording]) -> None:
    rng = np.random.default_rng(3)
    tumour = scanned(3, scene(50.0, 40.0, lump(6.0, 50.0)))
    said = compare(healthy[0], tumour)
    assert said.diseased == "undecided"
    assert "nothing to compare" in said.reason
    nothing = recording(row(rng))
    new = compare(nothing, healthy[0]).reason
    assert "only B shows an artery at x = 3" in new and "nothing to compare" in new
    only = compare(nothing, tumour).objects
    assert [(pair.a, pair.b and pair.b.kind) for pair in only] == [(None, "tumour")]


def test_presses_of_another_depth_do_not_say_whether_a_lump_grew() -> None:
    before = scanned(1, scene(30.0, 40.0, lump(6.0)))
    deeper = scanned(2, scene(30.0, 40.0, lump(6.0)), depth_m=3.5e-3)
    assert "press both alike" in compare(before, deeper).reason


def test_a_force_below_zero_is_not_compared() -> None:
    rng = np.random.default_rng(10)
    pulses = recording([station(rng, pulse_pa=300.0)])
    turned = recording([station(rng, level_pa=-9000.0, pulse_pa=300.0)])
    for pair, which in (((pulses, turned), "B"), ((turned, pulses), "A")):
        said = compare(*pair)
        assert (said.diseased, said.confidence) == ("undecided", 0.0)
        assert f"scan {which} reads no force above zero" in said.reason


def test_single_presses_are_compared_by_pulse_and_stiffness() -> None:
    rng = np.random.default_rng(10)
    one = recording([station(rng, level_pa=20000.0, pulse_pa=1500.0, relaxing=0.0)])
    same = recording([station(rng, level_pa=20000.0, pulse_pa=1500.0, relaxing=0.0)])
    placed = [replace(s, stations=tuple(replace(p, x_m=0.03) for p in s.stations))
              for s in (one, same)]  # fmt: skip
    for pair in ((one, same), placed):
        said = compare(*pair)
        assert said.peak_ratio == pytest.approx(1.0, rel=0.05) or said.diseased == "undecided"
        assert said.diseased in ("neither", "undecided")
