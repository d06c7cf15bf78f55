"""Scenes with other values, checked as a file is."""

from typing import Any

from sim_backend import Scene, load_scene


def changed(scene: Scene | str, **keys: Any) -> Scene:
    """With other ``keys``: of a table those that are given, of ``inclusion`` the first one's.

    A finger with a ``shape`` is another one.
    """
    raw = (load_scene(scene) if isinstance(scene, str) else scene).model_dump()
    for key, value in keys.items():
        if key == "inclusion" and isinstance(value, dict):
            value = [raw[key][0] | value, *raw[key][1:]]
        whole = not isinstance(value, dict) or "shape" in value
        raw[key] = value if whole else (raw[key] or {}) | value
    return Scene.model_validate(raw)
