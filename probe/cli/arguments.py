"""Arguments that several commands share, with what a shell can complete in them."""

from pathlib import Path
from typing import Annotated, Any

import typer

RunFile = Annotated[Path, typer.Argument(metavar="RUN", help="A run file.")]
RunFiles = Annotated[
    list[Path], typer.Argument(metavar="RUN...", help="One run file or several, say runs/*.run.")
]


def storable(value: Any) -> Any:
    """An option's text (or list of texts), which a file shall keep, as it is. Raises
    `typer.BadParameter` where it holds bytes that are not UTF-8: no file of ours can hold them."""
    from drivers.core.files import NO_TEXT, is_text

    for text in [value] if isinstance(value, str) else value or ():
        if not is_text(text):
            raise typer.BadParameter(f"{text!r}: {NO_TEXT}")
    return value


def scene_names(begun: str) -> list[str]:
    """Built-in scenes that begin so; the shell adds files itself."""
    from sim_backend.scene.scene_file import scene_names as built_in

    return [name for name in built_in() if name.startswith(begun)]


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
