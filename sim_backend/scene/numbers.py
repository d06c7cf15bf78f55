"""The numbers of a scene by their keys, as ``inclusion.0.wall_mm``, and scenes with another."""

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from sim_backend.scene.scene_file import Scene
from sim_backend.scene.table import Table, beyond_a_file

OF_BODY = ("tissue", "inclusion", "indenter")
"""Tables whose numbers a press depends on; the pulse's pressures are its loads."""


def numbers(scene: Scene) -> dict[str, float]:
    """Every number that shapes a press, by its key.

    Examples
    --------
    >>> import palpate
    >>> numbers(palpate.load_scene("TIT"))["inclusion.0.diameter_mm"]
    4.5
    """
    return {key: value for name in OF_BODY for key, value in _within(getattr(scene, name), name)}


def with_number(scene: Scene, key: str, value: float) -> Scene:
    """The scene with one other number, unchecked: it may lie a step beyond what a file may say.

    Raises KeyError.
    """
    if key not in numbers(scene):
        raise KeyError(key)
    changed: Scene = _changed(scene, key.split("."), value)
    return changed


def _within(part: Any, where: str) -> Iterator[tuple[str, float]]:
    if isinstance(part, tuple):
        for n, one in enumerate(part):
            if isinstance(one, BaseModel):
                yield from _within(one, f"{where}.{n}")
    elif isinstance(part, BaseModel):
        for name, value in part:
            if isinstance(value, float):
                yield f"{where}.{name}", value
            else:
                yield from _within(value, f"{where}.{name}")


def _changed(part: Any, path: list[str], value: float) -> Any:
    first, *rest = path
    if isinstance(part, tuple):
        n = int(first)
        return (*part[:n], _changed(part[n], rest, value), *part[n + 1 :])
    assert isinstance(part, Table)
    inner = _changed(getattr(part, first), rest, value) if rest else value
    return beyond_a_file(part, {first: inner})
