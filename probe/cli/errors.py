"""The one place that turns what went wrong into a message and an exit status."""

import errno
import os
import sys
import traceback
from typing import Any

import typer

from probe.cli import ABORTED

# Every complaint about the command line: click's base class, whichever click typer brings along.
Misused: Any = typer.BadParameter.__mro__[2]
BAD_INPUT, FAULT, UNSOLVED, BUG = 2, 3, 4, 70
STATUSES = {
    "sim_backend.fem.newton:CannotSolve": UNSOLVED,
    "sim_backend.scene.scene_file:SceneError": BAD_INPUT,
    "drivers.core.errors:DeviceFault": FAULT,
    "drivers.core.errors:ConfigError": BAD_INPUT,
    "probe.scan.remote:NotRunning": FAULT,
    "probe.config.rig:RigError": BAD_INPUT,
    "probe.core.errors:RunFileError": BAD_INPUT,
    "probe.core.errors:StoreError": BAD_INPUT,
    "probe.storage.import_table:CsvError": BAD_INPUT,
    "calibration.errors:CalibrationError": BAD_INPUT,
    "builtins:OSError": BAD_INPUT,
}

ELSEWHERE = "; name a place that you may write to"
INSTEAD = {
    errno.EACCES: ELSEWHERE,
    errno.EPERM: ELSEWHERE,
    errno.EROFS: ELSEWHERE,
    errno.ENAMETOOLONG: "; name a shorter one",
    errno.ENOSPC: "; make room there, or name another place",
}
"""What to do where the system lets nothing be written."""
EXTRA_OF = {
    "PySide6": "live",
    "pyqtgraph": "live",
    "pandas": "data",
    "xarray": "data",
    "h5py": "export",
    "h5netcdf": "export",
    "pyarrow": "export",
    "mcap": "export",
    "matplotlib": "report",
    "dask": "cluster",
    "meshio": "mesh",
}
"""Libraries that a command may ask for, and the extra that brings them."""


class Stopped(Exception):
    """Ctrl-C during a command; its text says what is kept, and where."""


def status_of(error: BaseException) -> tuple[int, str]:
    """Exit status, and what to say to the user (empty if it was said already)."""
    if isinstance(error, typer.Exit):
        return error.exit_code, ""
    if isinstance(error, Stopped | KeyboardInterrupt | typer.Abort):
        return ABORTED, f"stopped: {error}" if str(error) else "stopped"
    if isinstance(error, Misused):
        where = getattr(error, "ctx", None)
        command = where.command_path if where is not None else "palpate"
        text = _misused(error)
        if not text:  # a bare group has shown its help
            return BAD_INPUT, ""
        return BAD_INPUT, f"{text}\n`{command} --help` shows what is allowed"
    if isinstance(error, ModuleNotFoundError) and (error.name or "").split(".")[0] in EXTRA_OF:
        from drivers.core.extras import missing  # here: numpy comes with it

        module = str(error.name).split(".")[0]
        return BAD_INPUT, str(missing(EXTRA_OF[module], "this command", module))
    status = _known(error)
    if status is not None:
        return status, _plain(error)
    trace = "".join(traceback.format_exception(error)).rstrip()
    if os.environ.get("PALPATE_TRACE"):
        return BUG, trace
    return BUG, (
        f"This is a mistake in palpate itself: {type(error).__name__}: {error}\n"
        "Set PALPATE_TRACE=1 to see where, and please report it."
    )


def _misused(error: Any) -> str:
    """What is wrong with the command line; with a value that cannot be, the value too."""
    from pydantic import ValidationError  # here: pydantic and numpy take longer than all the rest

    from sim_backend.scene.explain import allowed

    said = str(error.format_message())
    why = error.__cause__
    if not isinstance(why, ValidationError):
        return said
    fault = why.errors()[0]
    given = "" if repr(fault["input"]) in fault["msg"] else f"{fault['input']!r} "
    return said.replace(fault["msg"], given + allowed(fault))


def _plain(error: BaseException) -> str:
    """What an error says; those of the operating system as file and reason."""
    if not isinstance(error, OSError) or error.strerror is None:
        return str(error)
    file: str | None = error.filename  # None: not of a file that we opened by its name
    if file and isinstance(error, FileExistsError | NotADirectoryError):
        return f"{file}: there is a file; a folder is needed"
    # `Path.is_file` raises for a name that is too long
    unreadable = file and os.path.isfile(file) and not os.access(file, os.R_OK)  # noqa: PTH113
    advice = "" if unreadable else INSTEAD.get(error.errno or 0, "")
    return f"{file or 'output could not be written'}: {error.strerror.lower()}{advice}"


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
