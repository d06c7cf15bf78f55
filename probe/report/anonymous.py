"""A run's settings without operator, place and time."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

from probe.core.events import RunStarted
from sim_backend.scene.scene_file import WAVES, scene_names

TELLING = ("labels", "host", "port", "file", "imported", "computer")
"""Keys whose values may name a person, a place or a machine; so may every ``*_uri`` and path."""


def anonymous(started: RunStarted) -> RunStarted:
    """Without labels, files, addresses, the computer and the date."""
    config: dict[str, Any] = _without(started.config)
    rig, scene = config.get("rig") or {}, config.get("scene") or {}
    rig.pop("calibration", None)  # kinds and names of files; what was in them stays
    # Names that a person gave to files: a built-in scene's and wave's own say nothing of anybody.
    if rig.get("scene") and rig["scene"].get("name") not in scene_names():
        rig["scene"].pop("name", None)
    if scene.get("pulse") and scene["pulse"].get("wave") not in WAVES:
        scene["pulse"].pop("wave", None)
    return replace(started, started_utc="", config=config)


def _without(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without(one) for key, one in value.items() if not _tells(str(key), one)}
    if isinstance(value, list | tuple):
        return [_without(one) for one in value if not _tells("", one)]
    return value


def _tells(key: str, value: Any) -> bool:
    return key in TELLING or key.endswith("_uri") or (isinstance(value, str) and _is_path(value))


def _is_path(text: str) -> bool:
    """Folders are often named after whoever works in them."""
    return PurePosixPath(text).is_absolute() or PureWindowsPath(text).is_absolute()
