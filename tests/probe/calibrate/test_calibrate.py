"""``palpate calibrate``: from tables and runs to files, scenes and warnings."""

import json
import re
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


def test_readings_without_any_noise_may_be_taken_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second table was compared with no residual at all, and ended in a division by 0."""
    table = tmp_path / "loads.csv"
    for zero, holds in ((0.2, True), (0.2, True), (0.3, True)):
        rows = [f"{zero + 1.25 * load},{load}" for load in range(1, 5)]
        table.write_text("\n".join(["raw,load_n", *rows]) + "\n")
        command = ["calibrate", "force", str(table), "--device", "a/b", "--out"]
        assert main([*command, str(tmp_path / "force.json")]) == 0
        assert ("no longer" in capsys.readouterr().err) != holds
    assert main([*command, str(tmp_path / "none" / "force.json")]) == 2
    assert "there is no folder" in capsys.readouterr().err


def test_a_sensor_that_clips_is_no_straight_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, noise = tmp_path / "loads.csv", np.random.default_rng(3)
    for most, warned in ((4.0, True), (9.0, False)):
        loads = [*range(5), *range(3, -1, -1)] * 2
        rows = [f"{min(0.2 + 1.25 * f, most) + 1e-3 * noise.normal()},{f}" for f in loads]
        table.write_text("\n".join(["raw,load_n", *rows]) + "\n")
        out = str(tmp_path / f"force-{most}.json")
        assert main(["calibrate", "force", str(table), "--device", "s", "--out", out]) == 0
        said = capsys.readouterr()
        assert ("does the sensor clip" in said.err) == warned
        assert "off a straight line by" in said.out


def test_taxels_that_stand_still_or_bend_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A good one, one of a dead zone to 4 kPa, one that falls and clips at 12 kPa, a bent one."""
    table, noise = tmp_path / "taxels.csv", np.random.default_rng(4)
    pressure = np.repeat(1e3 * np.array([0, 2, 4, 6, 8, 10, 15, 20]), 3)
    line = 0.01 * np.outer(pressure, [1, 1, -1, 1]) + [20, 20, 400, 20]
    line[:, 3] += 1e-7 * pressure**2
    raw = line + 0.5 * noise.standard_normal(line.shape)
    raw = np.clip(raw, [-1e3, 61, 280, -1e3], 1e4)
    rows = [",".join(map(str, [*r, p])) for r, p in zip(raw, pressure, strict=True)]
    table.write_text("\n".join(["raw_0,raw_1,raw_2,raw_3,pressure_pa", *rows]) + "\n")
    out = ["--device", "skin", "--out", str(tmp_path / "t.json")]
    assert main(["calibrate", "taxels", str(table), *out]) == 0
    said = capsys.readouterr().err
    assert re.search(r"readings of raw_1 stand still up to 4\.?\d* kPa and were left out", said)
    assert re.search(r"readings of raw_2 stand still from 1[12]\.?\d* kPa on and were left", said)
    assert re.search(r"no straight line fits raw_3, off it by up to \d\.?\d* %", said)
    assert "raw_0" not in said
    values = json.loads((tmp_path / "t.json").read_text())["values"]
    assert values["floor"]["value"][1:3] == [61, 280]
    assert values["bent"]["value"][0] == 0


def test_a_rig_that_stiffens_is_said_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From 2000 N/m at the touch to 3200 at 2 mm; 20 to 29 % off what it is at small load."""
    table, noise = tmp_path / "press.csv", np.random.default_rng(4)
    for bend, said in ((0.15, True), (0.0, False)):
        rows = [f"{d},{0.03 + 2 * max(d, 0) * (1 + bend * max(d, 0)) + 5e-3 * noise.normal()}"
                for d in np.linspace(-1, 2, 200)]  # fmt: skip
        table.write_text("\n".join(["depth_mm,force_n", *rows]))
        out = ["--device", "stage", "--out", str(tmp_path / f"c{bend}.json")]
        assert main(["calibrate", "compliance", str(table), *out]) == 0
        found = re.search(r"warning: the rig stiffens: from (\d+) N/m at the touch to (\d+) at 5",
                          capsys.readouterr().err)  # fmt: skip
        assert (found is not None) == said
        if found is not None:
            assert [float(k) for k in found.groups()] == pytest.approx([2000, 3200], rel=0.02)


@pytest.mark.parametrize(("stiffness_n_mm", "said"), [(0.288, True), (40.0, False)])
def test_a_rig_softer_than_a_lump_is_doubted(
    stiffness_n_mm: float, said: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Tissue in place of the rigid block became the rig's compliance without a word."""
    table, noise = tmp_path / "press.csv", np.random.default_rng(4)
    most_mm = 1.0 / stiffness_n_mm  # to a newton
    rows = [f"{d * most_mm},{stiffness_n_mm * max(d, 0) * most_mm + 2e-3 * noise.normal()}"
            for d in np.linspace(-0.5, 1, 200)]  # fmt: skip
    table.write_text("\n".join(["depth_mm,force_n", *rows]))
    out = ["--device", "stage", "--out", str(tmp_path / "c.json")]
    assert main(["calibrate", "compliance", str(table), *out]) == 0
    warned = " ".join(capsys.readouterr().err.split())
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


def loads(path: Path, gain: float) -> Path:
    rows = [f"{gain * n + 1e-3 * (n % 3 - 1)},{n}" for n in range(12)]
    path.write_text("\n".join(["raw,load_n", *rows]))
    return path


def test_a_calibration_that_no_longer_holds_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--device", "cell", "--out", str(tmp_path / "f.json")]
    tested = False  # the first has none before it
    for gain, worn in ((1.3, False), (1.3, False), (1.31, True)):
        table = loads(tmp_path / "loads.csv", gain)
        assert main(["calibrate", "force", str(table), *out]) == 0
        values = json.loads((tmp_path / "f.json").read_text())["values"]
        assert values["sensitivity"]["value"][0][0] == pytest.approx(gain, rel=1e-3)
        said = capsys.readouterr()
        assert ("times what its residuals allow" in said.err) is worn
        assert ("it still holds" in said.err) is (tested and not worn)
        assert "valid for 90 days:" in said.out
        tested = True
    assert main(["calibrate", "force", str(table), "--device", "other", *out[2:]]) == 2
    assert "holds a calibration of force of 'cell'" in capsys.readouterr().err


def test_readings_of_more_channels_do_not_replace_a_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They ended in numpy's words about matmul and broadcasting."""
    table, noise = tmp_path / "t.csv", np.random.default_rng(5)
    for kind, counts, reported in (
        ("force", (1, 3), "holds a calibration of 1 x 1 channels x loads, "),
        ("taxels", (4, 6), "holds a calibration of 4 taxels, "),
    ):
        out = tmp_path / f"{kind}.json"
        for count in counts:
            before = out.read_text() if out.exists() else ""
            loads = np.eye(3)[:, :count] if kind == "force" else np.ones((3, 1))
            loads = np.concatenate([f * loads for f in (0, 1, 2, 3, 4, 1)])
            raw = loads @ np.full((loads.shape[1], count), 0.2) + loads
            raw = raw + 1e-3 * noise.standard_normal(raw.shape)
            names = [f"raw_{n}" for n in range(count)]
            names += [f"load_{n}_n" for n in range(count)] if kind == "force" else ["pressure_pa"]
            rows = np.hstack([raw, loads * (1 if kind == "force" else 1e3)])
            np.savetxt(table, rows, delimiter=",", header=",".join(names), comments="")
            done = main(["calibrate", kind, str(table), "--device", "s", "--out", str(out)])
            assert done == (2 if before else 0)
            said = capsys.readouterr().err
        assert f"{out}: {reported}{table} has readings of" in said
        assert "Give another --out, or move the file" in said
        assert out.read_text() == before


def test_a_tare_says_how_long_it_is_good_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It drifts by 1e-3 a second, and its bias is known to the tenth part of its noise or so."""
    noise = np.random.default_rng(1).normal(0, 0.01, 400)
    table, out = tmp_path / "quiet.csv", str(tmp_path / "tare.json")
    rows = [f"{n / 100},{1 + 1e-5 * n + noise[n]}" for n in range(400)]
    table.write_text("\n".join(["time_s,value", *rows]))
    assert main(["calibrate", "tare", str(table), "--device", "cell", "--out", out]) == 0
    said = capsys.readouterr().out
    (found,) = re.findall(r"good for (\S+) s: then drift alone may exceed (\S+),", said)
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
