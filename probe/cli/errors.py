"""The one place that turns what went wrong into a message and an exit status."""

import os
import sys
import traceback
from typing import Any

import typer

# Every complaint about the command line: click's base class, whichever click typer brings along.
Misused: Any = typer.BadParameter.__mro__[2]
BAD_INPUT, FAULT, UNSOLVED, INTERRUPTED, BUG = 2, 3, 4, 130, 70
STATUSES = {
    "sim_backend.press:CannotSolve": UNSOLVED,
    "sim_backend.scene:SceneError": BAD_INPUT,
    "drivers.errors:DeviceFault": FAULT,
    "drivers.errors:ConfigError": BAD_INPUT,
    "probe.live.remote:NotRunning": FAULT,
    "probe.rig:RigError": BAD_INPUT,
    "probe.rows:RunFileError": BAD_INPUT,
    "probe.store:StoreError": BAD_INPUT,
    "probe.foreign_table:ForeignError": BAD_INPUT,
    "calibration.errors:CalibrationError": BAD_INPUT,
    "builtins:OSError": BAD_INPUT,
}


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
    """The status of an error that a user, a device or the physics caused.

    Only modules that are loaded can have raised; importing the others would take a second.
    """
    for place, status in STATUSES.items():
        module, name = place.split(":")
        kind = getattr(sys.modules.get(module), name, None)
        if kind is not None and isinstance(error, kind):
            return status
    return None
