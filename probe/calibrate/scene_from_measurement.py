"""Scene files that were measured: the block on the table, the pulse of a subject."""

from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from calibration import Calibration, HeartCalibration, TissueCalibration
from calibration.errors import CalibrationError
from sim_backend.scene.explain import explain
from sim_backend.scene.scene_file import Scene, scene_from_text

KINDS = ("tissue", "heart")
"""Of which a scene can be written."""


def check_scene_out(path: Path, kind: str) -> None:
    """Raises `CalibrationError` where no scene of ``kind`` can be written to ``path``, before
    anything is measured, fitted or written."""
    if kind not in KINDS:
        raise CalibrationError(f"--scene-out: only of {' or '.join(KINDS)}, not of {kind}")
    if not path.parent.is_dir():
        raise CalibrationError(f"--scene-out {path}: there is no folder {path.parent}")
    _need_free(path)


def wave_beside(path: Path) -> Path:
    """The file of a scene's own wave."""
    return path.with_name(f"{path.stem}-wave.csv")


def scene_found(scene: Scene, found: Calibration, path: Path) -> Scene:
    """What `write_found` writes to ``path``; nothing is written yet.

    Of a tissue ``scene``'s block and finger with the modulus and relaxation found, nothing else in
    it; of a heart ``scene`` with the subject's rate, levels and (where it was measured) wave.
    Raises `CalibrationError` where the fit says that this is no such block, or the wave's file
    exists already.
    """
    try:
        match found:
            case TissueCalibration():
                made = _of_tissue(scene, found)
            case HeartCalibration():
                made = _of_heart(scene, found, path)
            case _:
                raise CalibrationError(f"a calibration of {found.KIND} is of no scene")
        return made.model_copy(update={"name": path.stem})  # a name that can be no scene's, too
    except CalibrationError as error:
        raise CalibrationError(
            f"{path} was not written: {error}. Without --scene-out the calibration alone is written"
        ) from None
    except ValidationError as error:  # a value that was fitted and can be no scene's
        why = "; ".join(explain(error))
        raise CalibrationError(f"{path} was not written: {why}") from None


def write_found(made: Scene, found: Calibration, path: Path) -> None:
    """A scene of `scene_found`, and a heart's wave beside it. Raises `SceneError`."""
    if isinstance(found, HeartCalibration) and len(found.wave_mmhg):
        found.write_wave(wave_beside(path))
    write_scene(made, path)


def write_scene(scene: Scene, path: Path) -> None:
    """A scene's file, read back to be sure before it is written. Raises `SceneError` if it cannot
    be."""
    text = tomli_w.dumps(scene.model_dump(mode="json", exclude_none=True))
    scene_from_text(text, str(path))
    path.write_text(text, encoding="utf-8", newline="")


def _need_free(file: Path) -> None:
    if file.exists():
        raise CalibrationError(f"{file} exists already: move it, or give another --scene-out")


def _of_tissue(scene: Scene, found: TissueCalibration) -> Scene:
    if scene.tissue is None:
        raise CalibrationError(f"scene {scene.name} has no tissue")
    if not found.adequate:
        raise CalibrationError(
            "a homogeneous block does not explain the curve. " + "; ".join(found.cannot_identify)
        )
    _need_relaxation(found)
    g, tau = found.relaxation_g.tolist(), found.relaxation_tau_s.tolist()
    measured = {
        "modulus_kpa": round(1e-3 * float(found.modulus_pa[0]), 4),
        "relaxation": tuple((round(a, 4), round(b, 4)) for a, b in zip(g, tau, strict=True)),
    }
    tissue = scene.tissue.model_copy(update=measured)
    return scene.model_copy(update={"tissue": tissue, "inclusion": ()})


def _need_relaxation(found: TissueCalibration) -> None:
    """A tissue that does not relax is fitted with a weight about 0, of either sign."""
    intervals = dict(zip(found.fit.names, found.fit.interval().tolist(), strict=True))
    for n, weight in enumerate(found.relaxation_g.tolist()):
        low, high = intervals[f"g {n}"]
        if low <= 0:
            raise CalibrationError(
                f"relaxation is not to be distinguished from none: weight g {n} = {weight:.2g} "
                f"(95 %: {low:.2g} to {high:.2g}). Give one --relaxation-s less, or hold longer"
            )


def _of_heart(scene: Scene, found: HeartCalibration, path: Path) -> Scene:
    pulse: dict[str, Any] = {
        "rate_bpm": round(found.rate_bpm, 2),
        "systolic_mmhg": found.systolic_mmhg,
        "diastolic_mmhg": found.diastolic_mmhg,
    }
    if len(found.wave_mmhg):
        _need_free(wave_beside(path))
        pulse["wave"] = wave_beside(path).name
    return scene.model_copy(update={"pulse": scene.pulse.model_copy(update=pulse)})
