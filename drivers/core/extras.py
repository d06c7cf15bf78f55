"""What is installed only on request, and the line that installs it."""

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from drivers.core.errors import MissingExtra


def install_line(extra: str) -> str:
    """The command that adds ``extra`` to the Python that runs now."""
    return f"{shlex.quote(sys.executable)} -m pip install 'palpate[{extra}]'"


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


def missing(extra: str, what: str, module: str) -> MissingExtra:
    """The error that says what to install."""
    return MissingExtra(f"{what} needs {module}, which is not installed: {install_line(extra)}")
