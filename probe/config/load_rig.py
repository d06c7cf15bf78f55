"""Reading a rig file. A fault is named with file, key, value and what is allowed."""

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from calibration.errors import CalibrationError
from drivers import ConfigError
from drivers.core.files import FileRefused, parse_toml, path_of, read_file
from probe.config.calibrated import kind_of
from probe.config.rig import Rig, RigError
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.config.scan_planner import planner_for
from sim_backend.scene.explain import explain
from sim_backend.scene.scene_file import MAX_FILE_BYTES, scene_names


def load_rig(path: str | Path) -> Rig:
    """Read a rig file.

    Parameters
    ----------
    path
        The TOML file; paths in it are relative to its folder.

    Returns
    -------
    Rig
        Checked: every key is known and possible.

    Raises
    ------
    RigError
        Names the key, its value and what is allowed.

    Examples
    --------
    >>> import palpate
    >>> palpate.load_rig("rig.toml").scan.indentation_mm
    2.5
    """
    path = path_of(path, "a Rig or the name of a rig file")
    try:
        raw = parse_toml(read_file(path, MAX_FILE_BYTES))
    except FileRefused as error:
        hint = "; not a rig file" if path.is_file() else ""
        if str(path) in scene_names():
            hint = f"; {path} is a scene: say scene={str(path)!r}, in the shell --scene {path}"
        raise RigError(f"{error}{hint}") from None
    except ValueError as error:
        raise RigError(f"{path}: {error}") from None
    rig = checked_rig(raw, str(path), path.parent)
    update: dict[str, Any] = {}
    if rig.scene is not None and rig.scene.name not in scene_names():
        name = str(path.parent / rig.scene.name)
        update["scene"] = rig.scene.model_copy(update={"name": name})
    return rig.model_copy(update=update)


def checked_rig(raw: dict[str, Any], said_by: str, folder: Path = Path()) -> Rig:
    """The rig of a file's tables, of which a plan, limits and a planner can be made.

    The files of calibrations are relative to ``folder``. Raises `RigError` that begins with
    ``said_by``.
    """
    try:
        _find_calibrations(raw.get("calibration"), folder)
        rig = Rig.model_validate(raw)
        plan = plan_for(rig)
        limits_for(rig, plan)
        planner_for(rig, plan)
    except ValidationError as error:
        raise RigError("\n".join(f"{said_by}: {line}" for line in explain(error, Rig))) from None
    except (RigError, ConfigError, CalibrationError) as error:
        raise RigError(f"{said_by}: {error}") from None
    return rig


def _find_calibrations(files: Any, folder: Path) -> None:
    """Make the paths of calibrations relative to ``folder``, in place.

    Raises `RigError`, and `CalibrationError` for a kind that no scan applies.
    """
    if not isinstance(files, dict):
        return  # validation says what is wrong
    for kind, name in files.items():
        kind_of(kind)
        if isinstance(name, str):
            if not name:
                raise RigError(f"calibration.{kind} = '': name its file, or leave the line out")
            file = folder / name
            if not file.is_file():
                why = "a folder; name the file in it" if file.is_dir() else "no such file"
                raise RigError(f"calibration.{kind} = {str(file)!r}: {why}")
            files[kind] = str(file)
