"""Arguments that several commands share, with what a shell can complete in them."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

import typer


def _beginning(module: str, name: str) -> Callable[[str], list[str]]:
    """What a shell completes from the names that a ``module`` has, or gives when it is called."""

    def complete(begun: str) -> list[str]:
        names = getattr(import_module(module), name)
        return [one for one in (names() if callable(names) else names) if one.startswith(begun)]

    return complete


scene_names = _beginning("sim_backend.scene.scene_file", "scene_names")
"""The built-in ones; the shell adds files itself."""
calibration_kinds = _beginning("probe.cli.guide", "GUIDE")
emulated_devices = _beginning("sim_backend.emulators", "DEVICES")
SCENE = typer.Argument(help="A built-in scene or a scene file.", autocompletion=scene_names)
SceneName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE", help="What simulated devices press into.", autocompletion=scene_names
    ),
]
Fallback = Annotated[
    Literal["virtual"] | None,
    typer.Option(help="Let simulated devices take the place of absent ones."),
]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes; default: one per processor.")]
Accuracy = Annotated[
    float, typer.Option(metavar="PCT", help="Wanted accuracy of force and pulse [%].")
]
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


def rows_columns(text: str, option: str) -> tuple[int, int]:
    """``4x7``, of an array of taxels. Raises `typer.BadParameter`."""
    rows, mark, columns = text.lower().partition("x")
    if not (mark and rows.isdecimal() and columns.isdecimal() and int(rows) and int(columns)):
        raise typer.BadParameter(f"{option} {text}: must be rows x columns, such as 1x8 or 4x7")
    return int(rows), int(columns)


def planner_names(begun: str) -> list[str]:
    """Planners that are installed and begin so."""
    from drivers import available

    return [name for name in available("planners") if name.startswith(begun)]


def export_formats(begun: str) -> list[str]:
    """Formats of ``--to``, the last of a list that is being typed."""
    from probe.storage.export import WRITERS

    done, comma, last = begun.rpartition(",")
    return [f"{done}{comma}{name}" for name in WRITERS if name.startswith(last)]
