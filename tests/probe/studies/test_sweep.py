"""Sweeps: shared work, failures, interruptions, a cluster."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_block import BLOCK
from small_sweep import FAST, TIHA, made, without_time

from drivers import ConfigError
from probe.studies.fleet import fleet
from probe.studies.solve import jobs, solve
from probe.studies.sweep import solve_points, sweep, write
from probe.studies.vary import parse, points
from sim_backend.models.press import CannotSolve, press, scene_pressures_mmhg
from sim_backend.models.response import StationResponse
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import Scene


def test_pressures_share_one_solution() -> None:
    some = jobs(TIHA, enumerate(made("wall_mm=0.5,0.6", "systolic_mmhg=100,120,140")), (), 1.0,
                "small", 20.0)  # fmt: skip
    assert [len(job.points) for job in some] == [3, 3]
    rows = [row for each in solve(some[0]).values() for row in each]
    pulses = [row["pulse_n"] for row in rows]
    assert pulses == sorted(pulses)
    assert len({row["seconds"] for row in rows}) == 1  # solved once


def test_a_failed_point_is_a_row_with_its_reason(tmp_path: Path) -> None:
    table = solve_points(TIHA, made("wall_mm=0.63,99"), tmp_path / "t.csv", workers=1, **FAST)
    assert table["reason"].iloc[0] == ""
    assert table["reason"].iloc[1].startswith("inclusion[0] (artery): depth_mm = 12.66 breaks")
    assert table["force_n"].iloc[0] > 0


def asked_stations(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float, float, float]]:
    """The ends of the pulse [mmHg], place and greatest depth [mm] of stations that are solved."""
    asked: list[tuple[float, float, float, float]] = []

    def solved(scene: Scene, x_m: float, depth_m: float) -> StationResponse:
        asked.append((*scene_pressures_mmhg(scene), round(1e3 * x_m, 9), round(1e3 * depth_m, 9)))
        return respond(scene, x_m, depth_m)

    monkeypatch.setattr("probe.studies.solve.respond", solved)
    return asked


def test_a_station_is_solved_once_for_all_presses_at_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = asked_stations(monkeypatch)
    texts = ("indentation_mm=0.5,0.9,0.01,-1", "x_mm=12,13.5,99", "systolic_mmhg=110,120")
    wanted = points([parse(text, BLOCK) for text in texts], "full", 0, 0)
    (job,) = jobs(BLOCK, enumerate(wanted), (), 1.0, "quick", 1.0)
    table = pd.DataFrame([row for rows in solve(job).values() for row in rows])
    assert asked == [(80.0, 120.0, 12.0, 0.9), (80.0, 120.0, 13.5, 0.9)]
    solved = table[table["reason"] == ""]
    assert len(solved) == 3 * 2 * 2
    assert set(table[table["reason"] != ""]["reason"].str.split(" =").str[0]) == {
        "depth_mm",
        "x_mm",
    }
    one = solved.iloc[1]
    assert (one["indentation_mm"], one["x_mm"]) == (0.5, 12.0)
    pressed = press(BLOCK, 12.0, 0.5, (80.0, 120.0), model="finite").states
    low, high = (10 * state.force_n_per_mm for state in pressed)
    assert one["force_n"] == pytest.approx(low, rel=0.02)
    assert one["pulse_n"] == pytest.approx(high - low, rel=0.05)


def test_one_state_without_an_equilibrium_costs_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise CannotSolve("limit pressure", "found no equilibrium above 106 mmHg")

    monkeypatch.setattr("probe.studies.solve.respond", refuse)
    wanted = points([parse("indentation_mm=0.5,0.9", BLOCK)], "full", 0, 0)
    (job,) = jobs(BLOCK, enumerate(wanted), (), 1.0, "quick", 20.0)
    rows = [row for rows in solve(job).values() for row in rows]
    assert [(row["reason"], row["model"]) for row in rows] == [("", "finite")] * 2


def test_a_station_is_solved_for_the_pulses_of_all_points(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = asked_stations(monkeypatch)
    texts = ("diastolic_mmhg=70,60,80", "systolic_mmhg=130,140,110", "indentation_mm=1,2,1.5")
    wanted = points([parse(text, BLOCK) for text in texts], "zip", 0, 0)
    (job,) = jobs(BLOCK, enumerate(wanted), (), 1.0, "quick", 1.0)
    assert [row["reason"] for rows in solve(job).values() for row in rows] == [""] * 3
    assert asked == [(60.0, 140.0, 12.0, 2.0)]


@pytest.mark.parametrize("ending", ["csv", "parquet", "h5"])
def test_an_interrupted_sweep_goes_on(tmp_path: Path, ending: str) -> None:
    wanted, out = made("wall_mm=0.5,0.55,0.6"), tmp_path / f"t.{ending}"
    whole = solve_points(TIHA, wanted, tmp_path / "whole.csv", workers=1, **FAST)
    log = tmp_path / "whole.rows.jsonl"
    first_two = log.read_text().splitlines(keepends=True)[:3]
    out.with_suffix(".rows.jsonl").write_text("".join(first_two) + '{"point": 2, "wa')
    counted: list[int] = []
    again = solve_points(
        TIHA, wanted, out, workers=1, progress=lambda d, _: counted.append(d), **FAST
    )
    assert counted[0] == 2
    pd.testing.assert_frame_equal(without_time(whole), without_time(again), check_exact=True)
    assert out.stat().st_size > 0
    with pytest.raises(ConfigError, match="another sweep"):
        solve_points(TIHA, made("wall_mm=0.4"), out, workers=1, **FAST)


def test_scans_have_a_row_per_place(tmp_path: Path) -> None:
    wanted = made("wall_mm=0.5,99", "systolic_mmhg=110,130")
    table = solve_points(TIHA, wanted, tmp_path / "t.csv", x_mm=(24.0, 32.0), model="quick", seed=5,
                  workers=1)  # fmt: skip
    assert table["point"].tolist() == [0, 0, 1, 1, 2, 3]
    assert table["seed"].unique() == [5]
    solved = table[table["reason"] == ""]
    assert solved["x_mm"].tolist() == [24.0, 32.0] * 2
    over, beside = solved["pulse_n"][solved["x_mm"] == 32], solved["pulse_n"][solved["x_mm"] == 24]
    assert (over.to_numpy() > beside.to_numpy()).all()
    assert over.is_monotonic_increasing  # with the pressure
    again = solve_points(TIHA, wanted, tmp_path / "t.csv", x_mm=(24.0, 32.0), model="quick", seed=5)
    pd.testing.assert_frame_equal(table, again)  # nothing was solved anew


def test_unknown_ending(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"must end in \.parquet"):
        solve_points(TIHA, made("wall_mm=0.5"), tmp_path / "t.xlsx")


@pytest.mark.parametrize("ending", ["csv", "parquet", "h5"])
def test_a_file_that_is_no_sweeps_is_not_overwritten(tmp_path: Path, ending: str) -> None:
    out, wanted = tmp_path / f"t.{ending}", made("wall_mm=99")  # which is not solved
    own = pd.DataFrame({"subject": [1], "age": [40]})
    for content in (b"", b"my notes\n", None):
        if content is None:
            write(own, out)
        else:
            out.write_bytes(content)
        before = out.read_bytes()
        with pytest.raises(ConfigError, match="exists already and is no table of a sweep"):
            solve_points(TIHA, wanted, out, workers=1)
        with pytest.raises(ConfigError, match="exists already and is no table of a sweep"):
            fleet(1, out)
        assert out.read_bytes() == before
        assert list(tmp_path.iterdir()) == [out]
    out.unlink()
    for _ in range(2):  # the second time there is one, of a sweep whose log was removed
        assert len(solve_points(TIHA, wanted, out, workers=1)) == 1
        out.with_suffix(".rows.jsonl").unlink()
    out.unlink()
    out.mkdir()
    with pytest.raises(ConfigError, match="exists already"):
        solve_points(TIHA, wanted, out, workers=1)


def test_a_log_that_is_none_is_left_alone(tmp_path: Path) -> None:
    log = tmp_path / "t.rows.jsonl"
    log.write_text("[1, 2]\n")
    with pytest.raises(ConfigError, match=r"t\.rows\.jsonl belongs to another sweep"):
        solve_points(TIHA, made("wall_mm=99"), tmp_path / "t.csv", workers=1)
    assert log.read_text() == "[1, 2]\n"
    log.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="is no log of a sweep"):
        solve_points(TIHA, made("wall_mm=99"), tmp_path / "t.csv", workers=1)


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".h5"])
def test_a_column_may_hold_words_and_numbers(tmp_path: Path, ending: str) -> None:
    out = tmp_path / f"t{ending}"
    held = {"point": [0, 1], "bonded": ["true", 1.0], "model": ["finite", None], "seed": 0}
    write(pd.DataFrame(held | {"reason": ""}), out)
    assert out.exists()
    if ending == ".parquet":
        assert list(pd.read_parquet(out)["bonded"]) == ["true", "1.0"]
        assert list(pd.read_parquet(out)["model"].isna()) == [False, True]


def test_switches_are_taken_from_python(tmp_path: Path) -> None:
    vary = {"indenter.bonded": [True, False]}
    table = sweep("TI", vary, out=tmp_path / "a.csv", workers=1, accuracy_pct=20.0)
    assert list(table["reason"]) == ["", ""]
    bonded, free = table["force_n"]
    assert bonded > free
    with pytest.raises(ConfigError, match="--workers -1"):
        sweep("TI", vary, out=tmp_path / "b.csv", workers=-1, **FAST)


def test_python_takes_what_the_shell_takes(tmp_path: Path) -> None:
    listed = sweep("TIHA", {"wall_mm": [0.5, 0.6]}, out=tmp_path / "a.csv", workers=1, **FAST)
    ranged = sweep("TIHA", {"wall_mm": "0.5..0.6:2"}, out=tmp_path / "b.csv", workers=1, **FAST)
    pd.testing.assert_frame_equal(without_time(listed), without_time(ranged), check_exact=True)
    spaced = np.linspace(0.5, 0.6, 2)
    made = sweep("TIHA", {"wall_mm": spaced}, x_mm=32.0, out=tmp_path / "d.csv", workers=1, **FAST)
    pd.testing.assert_frame_equal(without_time(listed), without_time(made), check_exact=True)
    (one,) = sweep("TIHA", {"wall_mm": -1.0}, out=tmp_path / "e.csv", workers=1)["reason"]
    assert one == "inclusion.0.artery.wall_mm = -1.0: must be greater than 0"
    with pytest.raises(ConfigError, match="--vary wall: no such key"):
        sweep("TIHA", {"wall": [1.0]}, out=tmp_path / "c.csv")


def test_rows_of_a_log_that_does_not_say_whose_they_are_are_not_taken(tmp_path: Path) -> None:
    row = json.dumps({"point": 0, "rows": [{"point": 0, "force_n": 99.0, "reason": ""}]})
    (tmp_path / "a.rows.jsonl").write_text('{"swe\n' + row + "\n")
    with pytest.raises(ConfigError, match="first line is cut short; remove it"):
        sweep("TI", {"indentation_mm": [1.0]}, out=tmp_path / "a.csv", model="small", workers=1)
