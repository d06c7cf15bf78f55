"""``palpate calibrate --scene-out``: a scene beside the calibration, or neither."""

from pathlib import Path

import numpy as np
import pytest

import probe.calibrate.fits as module
from calibration import fit_heart
from calibration.errors import CalibrationError
from probe.calibrate.scene_from_measurement import scene_found, write_found
from probe.calibrate.tissue_force import proportional
from probe.cli import main
from sim_backend.scene.scene_file import load_scene

DEPTHS = np.linspace(0, 4e-3, 9)[1:]
BEATS_S = np.arange(0, 20, 0.01)
WAVE = 100 + 20 * np.sin(2 * np.pi * 1.1 * BEATS_S) + 8 * np.sin(4 * np.pi * 1.1 * BEATS_S)


@pytest.fixture
def springs(monkeypatch: pytest.MonkeyPatch) -> None:
    """400 N/m at 50 kPa, without finite elements."""
    monkeypatch.setattr(
        module, "force_of_modulus", lambda *_, **__: (proportional(DEPTHS, 8e-3 * DEPTHS), 0.0)
    )


def pressed(path: Path, g: float, seed: int) -> Path:
    """A ramp of 1 s and a hold of 3 s; the force relaxes by ``g`` with 0.5 s."""
    time_s = np.arange(0, 4, 0.02)
    depth_mm = 2 * np.minimum(time_s, 1.0)
    held_s = np.maximum(time_s - 1, 0.0)
    ramp = np.minimum(time_s, 1.0)
    memory = 2 * 0.5 * (1 - np.exp(-ramp / 0.5)) * np.exp(-held_s / 0.5)
    force = 0.4 * (depth_mm - g * (depth_mm - memory))
    force = force + 1e-3 * np.random.default_rng(seed).standard_normal(len(force))
    rows = [f"{t},{d},{f}" for t, d, f in zip(time_s, depth_mm, force, strict=True)]
    path.write_text("\n".join(["time_s,depth_mm,force_n", *rows]) + "\n")
    return path


@pytest.mark.usefixtures("springs")
def test_tissue_that_does_not_relax_gives_no_relaxing_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The weight came out below 0, and the scene was a mistake in palpate itself; or the time that
    belongs to no weight went on until it overflowed."""
    out, twin = tmp_path / "c.json", tmp_path / "twin.toml"
    for seed, g, relaxes in ((1, 0.0, False), (3, 0.0, False), (3, 0.3, True)):
        table = pressed(tmp_path / "t.csv", g, seed)
        done = main(["calibrate", "tissue", str(table), "--device", "b", "--relaxation-s", "0.5",
                     "--scene-out", str(twin), "--out", str(out)])  # fmt: skip
        assert (done, out.exists(), twin.exists()) == (0 if relaxes else 2, relaxes, relaxes)
        said = capsys.readouterr().err
        assert ("relaxation is not to be distinguished from none: weight g 0" in said) != relaxes
    tissue = load_scene(twin).tissue
    assert tissue is not None
    assert tissue.relaxation[0] == pytest.approx((0.3, 0.5), rel=0.1)


def test_a_file_that_is_there_is_kept_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "beats.csv"
    rows = [f"{t},{level}" for t, level in zip(BEATS_S, WAVE, strict=True)]
    table.write_text("\n".join(["time_s,pressure", *rows]))
    mine, wave = tmp_path / "mine.toml", tmp_path / "other-wave.csv"
    mine.write_text("mine")
    wave.write_text("mine too")
    there = sorted(tmp_path.iterdir())
    for kind, out, reported in (
        ("heart", mine, f"{mine} exists already: move it, or give another --scene-out"),
        ("heart", tmp_path / "other.toml", f"{wave} exists already"),
        ("heart", tmp_path / "none" / "x.toml", f"there is no folder {tmp_path / 'none'}"),
        ("heart", tmp_path / "c.json", "so is --out; name two files"),
        ("heart", tmp_path / f"{'x' * 101}.toml", "at most 100 printable characters"),
        ("force", tmp_path / "x.toml", "--scene-out: only of tissue or heart, not of force"),
    ):
        command = ["calibrate", kind, str(table), "--device", "d", "--scene-out", str(out)]
        assert main([*command, "--out", str(tmp_path / "c.json")]) == 2
        assert reported in " ".join(capsys.readouterr().err.split())
        assert sorted(tmp_path.iterdir()) == there
    assert (mine.read_text(), wave.read_text()) == ("mine", "mine too")


def test_a_subjects_pulse_becomes_a_scene(tmp_path: Path) -> None:
    found = fit_heart(BEATS_S, WAVE, (131.0, 77.0), is_pressure=True)
    made = scene_found(load_scene("TIHA"), found, tmp_path / "me.toml")
    assert not list(tmp_path.iterdir())
    write_found(made, found, tmp_path / "me.toml")
    pulse = load_scene(tmp_path / "me.toml").pulse
    assert pulse.rate_bpm == pytest.approx(66, rel=0.01)
    assert (pulse.systolic_mmhg, pulse.diastolic_mmhg) == (131.0, 77.0)
    assert Path(pulse.wave) == tmp_path / "me-wave.csv"
    levels = np.loadtxt(pulse.wave, delimiter=",", skiprows=1)[:, 1]
    assert (levels.min(), levels.max()) == pytest.approx((77.0, 131.0), abs=0.01)


def test_a_scene_of_something_else_is_none(tmp_path: Path) -> None:
    forces = module.calibration.fit_force(np.arange(5.0) * 2, np.arange(5.0))
    with pytest.raises(CalibrationError, match="a calibration of force is of no scene"):
        scene_found(load_scene("TI"), forces, tmp_path / "x.toml")
