"""Find a driver by the name a rig file gives it.

A third-party package registers a factory under the entry-point group ``palpate.stages`` or
``palpate.sensors``; nothing else is needed. A factory takes the clock and the keys of its table
in the rig file (as keyword arguments) and returns a `Stage` or a `Sensor`, not yet connected.
"""

from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any, Literal

from drivers.errors import ConfigError

Kind = Literal["stages", "sensors"]


def available(kind: Kind) -> list[str]:
    """Names that a rig file may give as ``driver``."""
    return sorted({point.name for point in entry_points(group=f"palpate.{kind}")})


def find_driver(kind: Kind, name: str) -> Callable[..., Any]:
    """The factory registered as ``name``. Raises `ConfigError` naming the known drivers."""
    for point in entry_points(group=f"palpate.{kind}"):
        if point.name == name:
            factory: Callable[..., Any] = point.load()
            return factory
    raise ConfigError(f"driver = {name!r}: no such driver; known: {', '.join(available(kind))}")
