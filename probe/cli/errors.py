"""The one place that turns what went wrong into a message and an exit status."""

import os
import traceback
from typing import Any

import typer

# Every complaint about the command line: click's base class, whichever click typer brings along.
Misused: Any = typer.BadParameter.__mro__[2]
BAD_INPUT, FAULT, UNSOLVED, INTERRUPTED, BUG = 2, 3, 4, 130, 70


def status_of(error: BaseException) -> tuple[int, str]:
    """Exit status, and what to tell the user (empty if it was told already)."""
    if isinstance(error, typer.Exit):
        return error.exit_code, ""
    if isinstance(error, KeyboardInterrupt | typer.Abort):
        return INTERRUPTED, "interrupted"
    if isinstance(error, Misused):
        where = getattr(error, "ctx", None)
        command = where.command_path if where is not None else "palpate"
        text = error.format_message().replace("Value error, ", "").replace("value error, ", "")
        if not text:  # a bare group has shown its help
            return BAD_INPUT, ""
        return BAD_INPUT, f"{text}\n`{command} --help` shows what is allowed"
    status = _known(error)
    if status is not None:
        return status, str(error)
    trace = "".join(traceback.format_exception(error)).rstrip()
    if os.environ.get("PALPATE_TRACE"):
        return BUG, trace
    return BUG, (
        f"This is a mistake in palpate itself: {type(error).__name__}: {error}\n"
        "Set PALPATE_TRACE=1 to see where, and please report it."
    )


def _known(error: BaseException) -> int | None:
    """The status of an error that a user, a device or the physics caused."""
    # Only now, when something failed anyway, are the modules worth their import.
    from drivers import ConfigError, DeviceFault
    from probe.foreign import ForeignError
    from probe.live.remote import NotRunning
    from probe.rig import RigError
    from probe.rows import RunFileError
    from probe.store import StoreError
    from sim_backend.press import CannotSolve
    from sim_backend.scene import SceneError

    statuses: tuple[tuple[type[BaseException], int], ...] = (
        (CannotSolve, UNSOLVED),
        (DeviceFault, FAULT),
        (NotRunning, FAULT),
        (RigError, BAD_INPUT),
        (SceneError, BAD_INPUT),
        (RunFileError, BAD_INPUT),
        (ForeignError, BAD_INPUT),
        (StoreError, BAD_INPUT),
        (ConfigError, BAD_INPUT),
        (OSError, BAD_INPUT),
    )
    return next((status for kind, status in statuses if isinstance(error, kind)), None)
