"""What is installed only on request, and the line that installs it."""

import platform
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from drivers.core.errors import MissingExtra


def install_line(extra: str) -> str:
    """The command that adds ``extra`` to the Python that runs now, or why there is none."""
    if extra == "ur" and not ur_has_wheel():
        return (
            f"ur-rtde has no wheel for Python {sys.version_info[0]}.{sys.version_info[1]} on "
            f"{platform.system()} {platform.machine()}; use Python 3.11 or 3.12 on x86-64, or "
            "build it as docs/reference/devices/ur.md says"
        )
    return f"{shlex.quote(sys.executable)} -m pip install 'palpate[{extra}]'"


def ur_has_wheel() -> bool:
    """Whether pip has ur-rtde ready made: the marker of the extra `ur` in ``pyproject.toml``."""
    return (
        sys.version_info < (3, 13)
        and platform.machine() in ("x86_64", "AMD64")
        and sys.platform != "darwin"
    )


@contextmanager
def needs(extra: str, what: str) -> Iterator[None]:
    """Within: imports of the libraries of ``extra``; ``what`` is said to need them.

    Raises `MissingExtra` in place of `ModuleNotFoundError`.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise missing(extra, what, error.name or extra) from None


def require(module: str, extra: str, what: str) -> None:
    """Raises `MissingExtra` unless ``module`` can be found; imports nothing."""
    if find_spec(module) is None:
        raise missing(extra, what, module)


LIBRARIES = {"ur": "rtde_control", "standa": "libximc", "netft": "pynetft", "lsl": "pylsl"}
"""What a driver needs beyond what palpate itself does; the extra that brings it bears its name."""


def require_library(driver: str) -> None:
    """Raises `MissingExtra` where ``driver`` has a library of `LIBRARIES` that is not there."""
    if driver in LIBRARIES:
        require(LIBRARIES[driver], driver, f'driver = "{driver}"')


def missing(extra: str, what: str, module: str) -> MissingExtra:
    """The error that says what to install."""
    return MissingExtra(f"{what} needs {module}, which is not installed: {install_line(extra)}")
