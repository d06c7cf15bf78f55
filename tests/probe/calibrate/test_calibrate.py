"""``palpate calibrate``: from tables and runs to files, scenes and warnings."""

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paths import ROOT

import probe.calibrate.fits as module
from calibration.errors import CalibrationError
from probe.calibrate.measurements import read
from probe.calibrate.scene_from_measurement import write_scene
from probe.calibrate.tissue_force import proportional
from probe.cli import main
from probe.cli.guide import GUIDE
from probe.config.rig import Rig
from probe.scan.session import scan
from sim_backend.scene.scene_file import load_scene, scene_names


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> Path:
    """Twelve light presses in a grid on springs of 400 N/m, the surface tilted by 1 in 40."""
    rig = Rig.model_validate(
        {
            "scan": {"start_mm": [8, -4], "pitch_mm": [8, 4], "stations": [4, 3], "hold_s": 0.1},
            "safety": {"workspace_mm": {"z": [-6, 50]}},
            "scene": {"name": "TI", "surface_mm": [[0, 0, 0], [40, 0, 1], [0, 4, 0]]},
        }
    )
    return scan(rig, out=tmp_path_factory.mktemp("runs"), respond=winkler).path


@dataclass
class Fit:
    """What ``palpate calibrate`` made of a table: its exit code, its words, its file."""

    code: int
    out: str
    err: str
    file: Path

    @property
    def values(self) -> dict[str, Any]:
        return {k: v["value"] for k, v in json.loads(self.file.read_text())["values"].items()}


@pytest.fixture
def calibrate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., Fit]:
    """Of rows under a head, of device ``s``; the file stays from one to the next."""

    def fitted(kind: str, head: str, rows: Iterable[Iterable[float]], *more: str) -> Fit:
        table, file = tmp_path / "table.csv", tmp_path / f"{kind}.json"
        lines = [head, *(",".join(map(str, row)) for row in rows)]
        table.write_text("\n".join(lines) + "\n")
        command = ["calibrate", kind, str(table), "--device", "s", "--out", str(file), *more]
        return Fit(main(command), *capsys.readouterr(), file)

    return fitted


@pytest.mark.parametrize("kind", GUIDE)
def test_without_readings_it_tells_how_to_take_them(
    kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", kind]) == 0
    assert f"palpate calibrate {kind}" in (said := capfd.readouterr().out)
    assert main(["calibrate", kind, "--json"]) == 0
    assert json.loads(capfd.readouterr().out) == {"kind": kind, "guide": said.rstrip("\n")}


def test_a_run_shows_where_the_surface_is(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "s.json"
    assert main(["calibrate", "surface", str(run), "--out", str(out)]) == 0
    reported = json.loads(out.read_text())
    assert reported["device"] == "virtual"
    assert reported["values"]["coefficients"]["value"][1] == pytest.approx(1 / 40, abs=1e-4)
    assert len(reported["raw"]["x_mm"]) == 12


def test_a_run_gives_stiffness_and_modulus(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    depths = np.linspace(0, 4e-3, 9)[1:]
    monkeypatch.setattr(
        module, "force_of_modulus", lambda *_, **__: (proportional(depths, 8e-3 * depths), 0.0)
    )  # 400 N/m at 50 kPa
    found = {}
    for kind in ("compliance", "tissue"):
        out = tmp_path / f"{kind}.json"
        assert main(["calibrate", kind, str(run), "--station", "6", "--out", str(out)]) == 0
        found[kind] = json.loads(out.read_text())["values"]
    assert found["compliance"]["stiffness_n_m"]["value"] == pytest.approx(400, rel=2e-3)
    assert found["tissue"]["modulus_pa"]["value"][0] == pytest.approx(50e3, rel=2e-3)


@pytest.mark.parametrize("arguments, reported", [
    (["force", "RUN"], "a run has no readings for force; a run gives latency, compliance"),
    (["heart", "RUN"], "no channel of role reference"),
    (["tissue", "RUN", "--station", "99"], "no such complete station"),
    (["latency", "RUN"], "too short to tell a delay from a clock's drift; record a chirp"),
    (["force", "gone.csv"], "gone.csv: no such file"),
    (["force", "."], ".: a folder, pipe or device; a file is needed"),
    (["heart", "RUN", "--cuff", "high"], "--cuff 'high': say it as 120/80"),
    (["wood", "RUN"], "kind 'wood': allowed are force"),
])  # fmt: skip
def test_what_cannot_be_is_explained(
    run: Path, arguments: list[str], reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", *(str(run) if a == "RUN" else a for a in arguments)]) == 2
    assert reported in " ".join(capsys.readouterr().err.split())


def test_a_table_says_not_whose_it_is_nor_what_a_word_means(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    table.write_text("raw,load_n\n1,1\ntwo,2\n3,\n")
    with pytest.raises(CalibrationError, match="column raw, row 2: 'two' is not a number"):
        read(table, "force").numbered("raw")
    assert main(["calibrate", "force", str(table)]) == 2


def test_readings_without_any_noise_may_be_taken_again(calibrate: Any, tmp_path: Path) -> None:
    """The second table was compared with no residual at all, and ended in a division by 0."""
    for zero in (0.2, 0.2, 0.3):
        rows = [(zero + 1.25 * load, load) for load in range(1, 5)]
        fit = calibrate("force", "raw,load_n", rows, "--device", "a/b")
        assert fit.code == 0
        assert "no longer" not in fit.err
    nowhere = str(tmp_path / "none" / "force.json")
    fit = calibrate("force", "raw,load_n", rows, "--device", "a/b", "--out", nowhere)
    assert fit.code == 2
    assert "there is no folder" in fit.err


@pytest.mark.parametrize(("most", "warned"), [(4.0, True), (9.0, False)])
def test_a_sensor_that_clips_is_no_straight_line(calibrate: Any, most: float, warned: bool) -> None:
    noise, loads = np.random.default_rng(3), [*range(5), *range(3, -1, -1)] * 2
    rows = [(min(0.2 + 1.25 * f, most) + 1e-3 * noise.normal(), f) for f in loads]
    fit = calibrate("force", "raw,load_n", rows)
    assert fit.code == 0
    assert ("does the sensor clip" in fit.err) == warned
    assert "off a straight line by" in fit.out


def test_taxels_that_stand_still_or_bend_are_named(calibrate: Any) -> None:
    """A good one, one of a dead zone to 4 kPa, one that falls and clips at 12 kPa, a bent one."""
    noise = np.random.default_rng(4)
    pressure = np.repeat(1e3 * np.array([0, 2, 4, 6, 8, 10, 15, 20]), 3)
    line = 0.01 * np.outer(pressure, [1, 1, -1, 1]) + [20, 20, 400, 20]
    line[:, 3] += 1e-7 * pressure**2
    raw = line + 0.5 * noise.standard_normal(line.shape)
    raw = np.clip(raw, [-1e3, 61, 280, -1e3], 1e4)
    fit = calibrate("taxels", "raw_0,raw_1,raw_2,raw_3,pressure_pa", np.c_[raw, pressure])
    assert fit.code == 0
    assert re.search(r"readings of raw_1 stand still up to 4\.?\d* kPa and were left out", fit.err)
    assert re.search(r"readings of raw_2 stand still from 1[12]\.?\d* kPa on and were", fit.err)
    assert re.search(r"no straight line fits raw_3, off it by up to \d\.?\d* %", fit.err)
    assert "raw_0" not in fit.err
    assert fit.values["floor"][1:3] == [61, 280]
    assert fit.values["bent"][0] == 0


@pytest.mark.parametrize(("bend", "said"), [(0.15, True), (0.0, False)])
def test_a_rig_that_stiffens_is_said_to(calibrate: Any, bend: float, said: bool) -> None:
    """From 2000 N/m at the touch to 3200 at 2 mm; 20 to 29 % off what it is at small load."""
    noise, at_mm = np.random.default_rng(4), np.linspace(-1, 2, 200)
    way = np.maximum(at_mm, 0)
    force_n = 0.03 + 2 * way * (1 + bend * way) + 5e-3 * noise.standard_normal(200)
    fit = calibrate("compliance", "depth_mm,force_n", np.c_[at_mm, force_n])
    assert fit.code == 0
    warning = r"warning: the rig stiffens: from (\d+) N/m at the touch to (\d+) at 5"
    found = re.search(warning, fit.err)
    assert (found is not None) == said
    if found is not None:
        assert [float(k) for k in found.groups()] == pytest.approx([2000, 3200], rel=0.02)


@pytest.mark.parametrize(("stiffness_n_mm", "said"), [(0.288, True), (40.0, False)])
def test_a_rig_softer_than_a_lump_is_doubted(
    calibrate: Any, stiffness_n_mm: float, said: bool
) -> None:
    """Tissue in place of the rigid block became the rig's compliance without a word."""
    at_mm = np.linspace(-0.5, 1, 200) / stiffness_n_mm  # to a newton
    noise_n = 2e-3 * np.random.default_rng(4).standard_normal(200)
    rows = np.c_[at_mm, stiffness_n_mm * np.maximum(at_mm, 0) + noise_n]
    fit = calibrate("compliance", "depth_mm,force_n", rows)
    assert fit.code == 0
    warned = " ".join(fit.err.split())
    doubt = "gives way by 3.5 mm at 1 N, softer than a hard lump in tissue (10 N/mm): was the block"
    assert (doubt in warned) == said
    assert ("was the block rigid" in warned) == said


def test_a_channel_left_out_is_not_another_one(tmp_path: Path) -> None:
    """raw_1 and raw_2 without raw_0 became channels 0 and 1."""
    table = tmp_path / "t.csv"
    for head, missing in (("raw_1,raw_2", "raw_0"), ("raw_0,raw_2", "raw_1")):
        table.write_text(f"{head},load_n\n1,2,3\n4,5,6\n")
        with pytest.raises(CalibrationError, match=f"column {missing} is missing, where .* raw_2"):
            read(table, "force").numbered("raw")
    table.write_text("load_1_n,raw\n1,2\n3,4\n")
    with pytest.raises(CalibrationError, match="column load_0_n is missing"):
        read(table, "force").numbered("load", "_n")


def test_what_a_table_leaves_open_names_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "rows.csv"
    table.write_text("raw,load_n\n1,1\n1,1\n")
    assert main(["calibrate", "force", str(table), "--device", "s"]) == 2
    assert capsys.readouterr().err.startswith(f"{table}: ")
    assert main(["calibrate", "force", str(table), "--device", "s", "--station", "3"]) == 2
    assert "--station 3 takes a press of a run; this is a table" in capsys.readouterr().err


def test_an_empty_cell_does_not_shift_a_column(tmp_path: Path) -> None:
    """One in each column: both have as many cells, which were paired with their neighbours'."""
    table, at_mm = tmp_path / "t.csv", np.linspace(-0.5, 1.5, 41)
    rows = [f"{d},{2 * max(d, 0)}".split(",") for d in at_mm]
    rows[12][0] = rows[30][1] = ""
    table.write_text("\n".join(["depth_mm,force_n", *map(",".join, rows)]))
    with pytest.raises(CalibrationError, match=r"column depth_mm, row 13 is empty: fill it"):
        module.calibrate("compliance", table)


def test_samples_of_stage_and_sensor_may_alternate_or_differ_in_number(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    table.write_text(
        "time_s,depth_mm,sensor_time_s,force_n\n0,1,,\n,,0.5,2\n1,3,,\n2,4,,\n,,1.5,5\n"
    )
    read_as = read(table, "latency")
    assert read_as.filled("time_s", "depth_mm").tolist() == [[0, 1], [1, 3], [2, 4]]
    assert read_as.filled("sensor_time_s", "force_n").tolist() == [[0.5, 2], [1.5, 5]]


def test_a_calibration_that_no_longer_holds_is_reported(calibrate: Any) -> None:
    for gain, worn, held in ((1.3, False, False), (1.3, False, True), (1.31, True, False)):
        rows = [(gain * n + 1e-3 * (n % 3 - 1), n) for n in range(12)]
        fit = calibrate("force", "raw,load_n", rows)
        assert fit.code == 0
        assert fit.values["sensitivity"][0][0] == pytest.approx(gain, rel=1e-3)
        assert ("times what its residuals allow" in fit.err) is worn
        assert ("it still holds" in fit.err) is held
        assert "valid for 90 days:" in fit.out
    fit = calibrate("force", "raw,load_n", rows, "--device", "other")
    assert fit.code == 2
    assert "holds a calibration of force of 's'" in fit.err


@pytest.mark.parametrize("kind, counts, reported", [
    ("force", (1, 3), "holds a calibration of 1 x 1 channels x loads, "),
    ("taxels", (4, 6), "holds a calibration of 4 taxels, "),
])  # fmt: skip
def test_readings_of_more_channels_do_not_replace_a_calibration(
    calibrate: Any, kind: str, counts: tuple[int, int], reported: str
) -> None:
    """They ended in numpy's words about matmul and broadcasting."""
    noise, before = np.random.default_rng(5), ""
    for count in counts:
        loads = np.eye(3)[:, :count] if kind == "force" else np.ones((3, 1))
        loads = np.concatenate([f * loads for f in (0, 1, 2, 3, 4, 1)])
        raw = loads @ np.full((loads.shape[1], count), 0.2) + loads
        raw = raw + 1e-3 * noise.standard_normal(raw.shape)
        names = [f"raw_{n}" for n in range(count)]
        names += [f"load_{n}_n" for n in range(count)] if kind == "force" else ["pressure_pa"]
        rows = np.hstack([raw, loads * (1 if kind == "force" else 1e3)])
        fit = calibrate(kind, ",".join(names), rows)
        assert fit.code == (2 if before else 0)
        before = before or fit.file.read_text()
    assert f"{fit.file}: {reported}{fit.file.with_name('table.csv')} has readings of" in fit.err
    assert "Give another --out, or move the file" in fit.err
    assert fit.file.read_text() == before


def test_a_tare_says_how_long_it_is_good_for(calibrate: Any) -> None:
    """It drifts by 1e-3 a second, and its bias is known to the tenth part of its noise or so."""
    noise = np.random.default_rng(1).normal(0, 0.01, 400)
    rows = [(n / 100, 1 + 1e-5 * n + noise[n]) for n in range(400)]
    fit = calibrate("tare", "time_s,value", rows)
    assert fit.code == 0
    (found,) = re.findall(r"good for (\S+) s: then drift alone may exceed (\S+),", fit.out)
    good_s, known_to = map(float, found)
    assert known_to == pytest.approx(2 * 0.01 / 20, rel=0.3)  # 66 batches know it to 9 %
    assert 0.2 < good_s < 1.0


@pytest.mark.parametrize("name", scene_names())
def test_a_written_scene_is_the_scene(name: str, tmp_path: Path) -> None:
    scene = load_scene(name).model_copy(update={"name": "twin"})
    write_scene(scene, tmp_path / "twin.toml")
    assert load_scene(tmp_path / "twin.toml") == scene


def test_a_block_that_is_none_gives_no_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A stiff layer below 1 mm: the force bends where no homogeneous block's does."""
    depths = np.linspace(0, 4e-3, 9)[1:]
    monkeypatch.setattr(
        module, "force_of_modulus", lambda *_, **__: (proportional(depths, 8e-3 * depths), 0.0)
    )
    rng, deep = np.random.default_rng(1), np.linspace(0, 2.0, 200)
    force = 0.4 * deep + 1.2 * np.maximum(deep - 1, 0) + 1e-3 * rng.standard_normal(200)
    table = tmp_path / "t.csv"
    table.write_text("depth_mm,force_n\n" + "\n".join(f"{d},{f}" for d, f in
                                                      zip(deep, force, strict=True)))  # fmt: skip
    twin = tmp_path / "twin.toml"
    done = main(["calibrate", "tissue", str(table), "--device", "block", "--scene-out", str(twin),
                 "--out", str(tmp_path / "c.json")])  # fmt: skip
    assert done == 2
    assert [one.name for one in tmp_path.iterdir()] == ["t.csv"]
    assert "a homogeneous block does not explain the curve" in capsys.readouterr().err


@pytest.mark.slow
def test_the_pages_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "how-to" / "calibration.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for name, text in re.findall(r"^```csv (\S+)\n(.*?)^```", page, re.MULTILINE | re.DOTALL):
        Path(name).write_text(text)
    commands = re.findall(r"^\$ palpate (.*)$", page, re.MULTILINE)
    assert len(commands) >= 5
    for command in commands:
        words = [w for part in command.split() for w in (sorted(map(str, Path().glob(part)))
                                                         if "*" in part else [part])]  # fmt: skip
        assert main(words) == 0, command
    assert load_scene("block.toml").tissue.modulus_kpa == pytest.approx(50.0, rel=2e-3)  # type: ignore[union-attr]
