"""Scene files that were measured: the block on the table, the pulse of a subject."""

from pathlib import Path
from typing import Any

import tomli_w

from calibration import HeartCalibration, TissueCalibration
from calibration.errors import CalibrationError
from sim_backend.scene.scene_file import Scene, load_scene


def write_tissue_scene(scene: Scene, found: TissueCalibration, path: Path) -> None:
    """``scene``'s block and finger with the modulus and relaxation found, nothing else in it.

    Raises `CalibrationError` where the fit says that this is no such block.
    """
    if scene.tissue is None:
        raise CalibrationError(f"scene {scene.name} has no tissue")
    if not found.adequate:
        raise CalibrationError(
            f"{path} was not written: a homogeneous block does not explain the curve. "
            + "; ".join(found.cannot_identify)
        )
    g, tau = found.relaxation_g.tolist(), found.relaxation_tau_s.tolist()
    measured = {
        "modulus_kpa": round(1e-3 * float(found.modulus_pa[0]), 4),
        "relaxation": tuple((round(a, 4), round(b, 4)) for a, b in zip(g, tau, strict=True)),
    }
    tissue = scene.tissue.model_copy(update=measured)
    write_scene(scene.model_copy(update={"tissue": tissue, "inclusion": ()}), path)


def write_heart_scene(scene: Scene, found: HeartCalibration, path: Path) -> None:
    """``scene`` with the subject's rate, levels and (where it was measured) wave beside it."""
    pulse: dict[str, Any] = {
        "rate_bpm": round(found.rate_bpm, 2),
        "systolic_mmhg": found.systolic_mmhg,
        "diastolic_mmhg": found.diastolic_mmhg,
    }
    if len(found.wave_mmhg):
        wave = path.with_name(f"{path.stem}-wave.csv")
        found.write_wave(wave)
        pulse["wave"] = wave.name
    write_scene(scene.model_copy(update={"pulse": scene.pulse.model_copy(update=pulse)}), path)


def write_scene(scene: Scene, path: Path) -> None:
    """A scene file of that name, read back to be sure. Raises `SceneError` if it cannot be."""
    plain = scene.model_copy(update={"name": path.stem}).model_dump(mode="json", exclude_none=True)
    path.write_text(tomli_w.dumps(plain), encoding="utf-8", newline="")
    load_scene(path)
