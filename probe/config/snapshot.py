"""Everything that is needed to know what a run's samples mean, as JSON-able values."""

import math
import platform
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from drivers import ConfigError
from drivers.core.files import NO_TEXT, is_text, read_file
from probe.config.rig import Rig
from probe.planning.plan import Plan
from probe.planning.press_direction import normal_of
from sim_backend.scene.scene_file import WAVES, Scene

MAX_CONTENT_BYTES = 4 * 1024**2
LIBRARIES = ("palpate", "numpy", "scipy")


def run_config(rig: Rig, scene: Scene | None, plan: Plan, seed: int) -> dict[str, Any]:
    """The ``config`` of `RunStarted`.

    ``face_mm2`` is that of `face_mm2_of`.
    """
    starts = [plan.at_surface(place) for place in plan.places]
    return {
        "rig": rig.model_dump(mode="json"),
        "scene": None if scene is None else scene.model_dump(mode="json"),
        "wave": None
        if scene is None or scene.pulse.wave in WAVES
        else _file(Path(scene.pulse.wave)),
        "plan": {
            "stations": [[p.index, 1e3 * p.x_m, 1e3 * p.y_m] for p in plan.places],
            "columns": ["index", "x_mm", "y_mm"],
            "surface_mm": [1e3 * start.z for start in starts],
            "incline_deg": [math.degrees(math.acos(normal_of(start)[2])) for start in starts],
            "travel_z_mm": 1e3 * plan.travel_z_m,
            "indentation_mm": 1e3 * plan.indentation_m,
            "force_n": plan.force_n,
            "steps_mm": [1e3 * step_m for step_m in plan.steps_m],
            "steps_n": list(plan.steps_n),
            "step_hold_s": plan.step_hold_s if plan.steps else None,
            "ramp_s": plan.ramp_s,
            "hold_s": plan.hold_s,
        },
        "calibration": {kind: _file(Path(name)) for kind, name in rig.calibration.items()},
        "versions": library_versions(),
        "computer": this_computer(),
        "seed": seed,
        "face_mm2": face_mm2_of(rig, scene),
    }


def check_text(where: str, kept: Any) -> None:
    """Raises `ConfigError` where ``kept``, as JSON has it, holds text that no run can: names of
    files and labels may."""
    if isinstance(kept, dict):
        for key, value in kept.items():
            check_text(where, key)
            check_text(f"{where}.{key}", value)
    elif isinstance(kept, list):
        for value in kept:
            check_text(where, value)
    elif isinstance(kept, str) and not is_text(kept):
        raise ConfigError(f"{where} = {kept!r}: {NO_TEXT}")


def face_mm2_of(rig: Rig, scene: Scene | None) -> float | None:
    """The probe's face: the rig's, or that of a simulated array with a pitch, or the indenter's of
    a simulated scene, or None."""
    if rig.face_mm2 is not None:
        return rig.face_mm2
    match rig.sensor[0].settings.get("array"):
        case {"rows": int(rows), "columns": int(columns), "pitch_mm": float() | int() as pitch_mm}:
            return float(rows * columns * pitch_mm**2)
    return scene.face_mm2 if scene is not None else None


def this_computer() -> str:
    """An identifier of this computer, without its name."""
    return sha256(platform.node().encode()).hexdigest()[:16]


def library_versions() -> dict[str, str]:
    """What computed the numbers."""
    return {name: version(name) for name in LIBRARIES} | {"python": platform.python_version()}


def _file(path: Path) -> dict[str, Any]:
    """A file with what was in it, so that a run stays readable when the file has changed.

    Raises `drivers.core.files.FileRefused`: the path may come from somebody else's run.
    """
    content = read_file(path, MAX_CONTENT_BYTES)
    text = content.decode("utf-8", errors="replace")
    try:
        kept: Any = from_json(text, allow_inf_nan=False)
    except ValueError:
        kept = text
    return {"file": str(path), "sha256": sha256(content).hexdigest(), "content": kept}
