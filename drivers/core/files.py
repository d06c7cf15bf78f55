"""Files from others, read with a bound: no pipe to wait for, no device without an end."""

import os
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

NO_TEXT = "holds bytes that are not UTF-8, and cannot be stored; write it in UTF-8"
MAX_DEPTH = 32  # tables within tables; a rig file has four


class FileRefused(OSError):
    """Not a file of bounded size: the text names it and says why."""


def path_of(given: object, wanted: str) -> Path:
    """A file's path. Raises `TypeError`, saying that ``wanted`` is, for what names no file."""
    if isinstance(given, str | os.PathLike):
        return Path(given)
    raise TypeError(f"{wanted} is needed; what was given is of type {type(given).__name__}")


def is_text(given: str) -> bool:
    """Whether UTF-8 can hold it: of other bytes in a command or file name Python makes halves of
    characters."""
    try:
        given.encode()
    except UnicodeEncodeError:
        return False
    return True


def open_file(path: Path) -> BinaryIO:
    """A regular file, open for reading. Raises `FileRefused`; opening never waits."""
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | os.O_CLOEXEC)
    except FileNotFoundError:
        raise FileRefused(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        why = getattr(error, "strerror", None) or error
        raise FileRefused(f"{str(path)!r}: cannot be opened ({why})") from None
    if not stat.S_ISREG(os.fstat(handle).st_mode):  # before fdopen, which names a folder by number
        os.close(handle)
        raise FileRefused(f"{path}: a folder, pipe or device; a file is needed")
    return os.fdopen(handle, "rb")


@contextmanager
def naming(file: Path) -> Iterator[None]:
    """Within, an error of the system names ``file``: a full disk names none."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(file)
        raise


def read_file(path: Path, max_bytes: int) -> bytes:
    """What is in a file of at most ``max_bytes``. Raises `FileRefused`."""
    with open_file(path) as file:
        try:
            content = file.read(max_bytes + 1)
        except OSError as error:
            raise FileRefused(f"{path}: cannot be read ({error.strerror})") from None
    if len(content) > max_bytes:
        raise FileRefused(f"{path}: larger than {max_bytes} bytes")
    return content


def parse_toml(content: bytes) -> dict[str, Any]:
    """A TOML file's tables, at most `MAX_DEPTH` deep. Raises `ValueError` saying what is wrong."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 text ({error.reason})") from None
    try:
        parsed = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not TOML: {error}") from None
    except RecursionError:
        raise ValueError(f"not TOML: nested more than {MAX_DEPTH} deep") from None
    level: list[Any] = [parsed]
    for _ in range(MAX_DEPTH):
        level = [inner for outer in level for inner in _within(outer)]
        if not level:
            return parsed
    raise ValueError(f"not TOML: nested more than {MAX_DEPTH} deep")


def _within(value: Any) -> list[Any]:
    """The tables and arrays directly inside a table or array."""
    inside = value.values() if isinstance(value, dict) else value
    return [one for one in inside if isinstance(one, dict | list)]
