"""What is varied, the points it makes, and what is drawn for a fleet."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import ConfigError
from probe.studies.fleet import KINDS, drawn, fleet, force_n
from probe.studies.vary import Varied, applied, full_key, parse, places, points
from sim_backend import load_scene

TIHA = load_scene("TIHA")


@pytest.mark.parametrize("text, key, values", [
    ("wall_mm=0.4,0.63", "inclusion.0.wall_mm", (0.4, 0.63)),
    ("tissue.modulus_kpa=10..50:5", "tissue.modulus_kpa", (10.0, 20.0, 30.0, 40.0, 50.0)),
    ("tissue.modulus_kpa=1..100:3log", "tissue.modulus_kpa", (1.0, 10.0, 100.0)),
    ("plane=stress,strain", "plane", ("stress", "strain")),
    ("indentation_mm=1,2", "indentation_mm", (1.0, 2.0)),
])  # fmt: skip
def test_values(text: str, key: str, values: tuple[float | str, ...]) -> None:
    one = parse(text, TIHA)
    assert one.key == key
    if isinstance(values[0], str):
        assert one.values == values
    else:
        assert one.values == pytest.approx(values)


@pytest.mark.parametrize("text, reported", [
    ("wal_mm=1", "no such key .did you mean wall_mm"),
    ("inner_diameter=3,4", "did you mean inner_diameter_mm"),
    ("nothing_alike=3,4", "no such key; known are"),
    ("modulus_kpa=1", "which of"),
    ("wall_mm", "say KEY="),
    ("wall_mm=1..x", "say KEY="),
    ("wall_mm=0.4,a", "'a' is no number"),
    ("x_mm=left", "'left' is no number"),
    ("wall_mm=0..1:log", "above 0"),
    ("wall_mm=0.4..0.6:-5", "from 1 to 1000000 values"),
    ("wall_mm=0.4..0.6:100000000000000", "from 1 to 1000000 values"),
])  # fmt: skip
def test_wrong_ones_are_explained(text: str, reported: str) -> None:
    with pytest.raises(ConfigError, match=reported):
        parse(text, TIHA)


def test_places() -> None:
    assert places("") == ()
    assert places("32") == (32.0,)
    assert places("20,32") == (20.0, 32.0)
    assert places("4..60:15") == tuple(4.0 * n for n in range(1, 16))
    for wrong in ("here", "4..60", "4..60:x", "4..:3", "4..60:0", "4..60:-3", "4..60:1000000000"):
        with pytest.raises(ConfigError, match="--x"):
            places(wrong)


def test_full_and_zipped() -> None:
    a, b = Varied("a", (1.0, 2.0)), Varied("b", (3.0, 4.0))
    assert len(points([a, b], "full", 0, 0)) == 4
    assert points([a, b], "zip", 0, 0) == [{"a": 1.0, "b": 3.0}, {"a": 2.0, "b": 4.0}]
    with pytest.raises(ConfigError, match="as many values"):
        points([a, Varied("b", (3.0,))], "zip", 0, 0)
    with pytest.raises(ConfigError, match="how many"):
        points([Varied("a", low=1, high=2)], "full", 0, 0)
    many = tuple(map(float, range(1001)))
    with pytest.raises(ConfigError, match=r"makes 1e\+06 points, at most 1000000"):
        points([Varied("a", many), Varied("b", many)], "full", 0, 0)


@pytest.mark.parametrize("design, count, seed, said", [
    ("LHS", 3, 0, "must be full, zip, lhs, sobol"),
    ("lhs", 0, 0, "how many points"),
    ("sobol", 100_000_000_000, 0, "1 to 1000000"),
    ("lhs", 2.5, 0, "count 2.5"),
    ("lhs", 3, -1, "seed -1: must be 0 or more"),
])  # fmt: skip
def test_designs_that_cannot_be_are_refused(design: Any, count: Any, seed: int, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        points([Varied("a", low=1, high=2)], design, count, seed)


@given(st.integers(2, 40), st.integers(0, 99), st.sampled_from(["lhs", "sobol"]))
def test_random_designs_fill_each_interval(count: int, seed: int, design: str) -> None:
    varied = [Varied("a", low=1, high=3), Varied("b", low=1, high=100, log=True)]
    made = points(varied, design, count, seed)
    assert len(made) == count
    assert made == points(varied, design, count, seed)
    a = np.array([p["a"] for p in made], dtype=float)
    assert ((a >= 1) & (a <= 3)).all()
    if design == "lhs":  # one in each of `count` equal parts
        assert len(set(((a - 1) / 2 * count).astype(int).clip(max=count - 1))) == count


def test_applied_to_the_scene_and_nothing_else() -> None:
    key = full_key("inner_diameter_mm", TIHA)
    changed = applied(TIHA, {key: 3.0, "indentation_mm": 2.0})
    assert changed.arteries[0].inner_diameter_mm == 3.0
    assert applied(changed, {key: 4.5}) == TIHA


@pytest.mark.parametrize("kind", KINDS)
def test_all_that_is_drawn_is_possible(kind: str) -> None:
    scene = load_scene(KINDS[kind])
    for point in drawn(kind, 40, 3):
        applied(scene, point)  # raises where it is not
    assert drawn(kind, 5, 3) == drawn(kind, 5, 3) != drawn(kind, 5, 4)


def test_kinds_are_drawn_from_seeds_of_their_own() -> None:
    lumps, vessels = ([p["tissue.height_mm"] for p in drawn(kind, 5, 0)]
                      for kind in ("tumour", "artery"))  # fmt: skip
    assert lumps != vessels


def test_a_beat_goes_through_diastole_middle_and_systole() -> None:
    rows = pd.DataFrame({"force_n": [1.0, 2.0], "pulse_n": [0.1, 0.0], "half_pulse_n": [0.04, 0.0]})
    force = force_n(rows, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(force, [[1.0, 1.04, 1.1], [2.0, 2.0, 2.0]])


@pytest.mark.slow
def test_a_fleet_has_every_kind_and_what_was_drawn(tmp_path: Path) -> None:
    out = tmp_path / "fleet.parquet"
    table = fleet(1, out, seed=1, x_mm=(16.0, 32.0), workers=1)
    pd.testing.assert_frame_equal(pd.read_parquet(out), table)
    assert table["kind"].tolist() == [kind for kind in KINDS for _ in range(2)]
    assert (table["reason"] == "").all()
    beats = table["kind"].str.contains("artery")
    assert (table["pulse_n"][beats] != 0).all()
    assert (table["pulse_n"][~beats] == 0).all()
    assert table["inclusion.0.depth_mm"].notna().tolist() == [k != "nothing" for k in table["kind"]]
