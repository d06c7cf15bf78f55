"""Arguments that several commands share, with what a shell can complete in them."""

from pathlib import Path
from typing import Annotated, Any

import typer

RunFile = Annotated[Path, typer.Argument(metavar="RUN", help="A run file.")]
RunFiles = Annotated[
    list[Path], typer.Argument(metavar="RUN...", help="One run file or several, say runs/*.run.")
]


MAX_STATION = 100_000
"""As many as a rig file can ask for."""


def storable(value: Any) -> Any:
    """An option's text (or list of texts), which a file shall keep, as it is. Raises
    `typer.BadParameter` where it holds bytes that are not UTF-8: no file of ours can hold them."""
    from drivers.core.files import NO_TEXT, is_text

    for text in [value] if isinstance(value, str) else value or ():
        if not is_text(text):
            raise typer.BadParameter(f"{text!r}: {NO_TEXT}")
    return value


def station_numbers(text: str, option: str) -> list[int]:
    """``5-9``, ``2,4`` or both as numbers from 1. Raises `typer.BadParameter`."""
    numbers: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        last = last if dash else first
        if not (first.isdecimal() and last.isdecimal() and int(first) >= 1):
            raise typer.BadParameter(f"{option} {text}: say station numbers as 5-9 or 2,4,7")
        if int(last) < int(first):
            raise typer.BadParameter(f"{option} {text}: {part.strip()} ends before it begins")
        if int(last) > MAX_STATION:
            raise typer.BadParameter(f"{option} {text}: no scan has so many stations")
        numbers.update(range(int(first), int(last) + 1))
    return sorted(numbers)


def scene_names(begun: str) -> list[str]:
    """Built-in scenes that begin so; the shell adds files itself."""
    from sim_backend.scene.scene_file import scene_names as built_in

    return [name for name in built_in() if name.startswith(begun)]


def planner_names(begun: str) -> list[str]:
    """Planners that are installed and begin so."""
    from drivers import available

    return [name for name in available("planners") if name.startswith(begun)]


def export_formats(begun: str) -> list[str]:
    """Formats of ``--to``, the last of a list that is being typed."""
    from probe.storage.export import WRITERS

    done, comma, last = begun.rpartition(",")
    return [f"{done}{comma}{name}" for name in WRITERS if name.startswith(last)]


def calibration_kinds(begun: str) -> list[str]:
    """Kinds of calibration that begin so."""
    from probe.cli.guide import GUIDE

    return [kind for kind in GUIDE if kind.startswith(begun)]


def emulated_devices(begun: str) -> list[str]:
    """Devices that can be emulated and begin so."""
    from sim_backend.emulators import DEVICES

    return [name for name in DEVICES if name.startswith(begun)]
