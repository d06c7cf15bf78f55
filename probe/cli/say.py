"""Where output goes: the answer to standard output, everything else to standard error."""

import io
import json
import math
import os
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from probe.cli import undisturbed

if TYPE_CHECKING:  # only some commands draw tables
    from rich.console import Console
    from rich.table import Table

Json = Annotated[
    bool, typer.Option("--json", help="Print exactly one JSON object on standard output.")
]
_json_file: list[int] = []
_answered: list[int] = []
LAST_STREAM = 2  # standard input, output and error are 0, 1 and 2


def keep_streams() -> None:
    """Stand-ins for standard streams that are closed (`>&-`), so that no file takes their place.

    A character of an answer that the terminal's encoding lacks is written as a question mark.
    """
    with suppress(OSError):  # no descriptor is left: then none can be taken either
        while (free := os.open(os.devnull, os.O_RDWR)) <= LAST_STREAM:
            pass
        os.close(free)
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            nowhere = Path(os.devnull).open("r+", encoding="utf-8")  # noqa: SIM115 - stays open
            setattr(sys, name, nowhere)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def inform(text: str) -> None:
    """A line for the person at the terminal, never part of the answer."""
    with suppress(OSError):  # the terminal may be gone; the scan and its file are not
        print(visible(text), file=sys.stderr, flush=True)


def answer(text: str) -> bool:
    """A line of the answer that a person asked for; False where whoever read it has gone."""
    return _print(visible(text) + "\n")


def answer_table(console: "Console", table: "Table") -> bool:
    """A table of the answer, as `answer` has a line."""
    with console.capture() as drawn:
        console.print(table)
    return _print(drawn.get())


def _print(text: str) -> bool:
    try:
        print(text, end="", flush=True)
    except BrokenPipeError:  # `| head` has enough: no fault, and no more is printed
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        return False
    return True


def answer_json(values: Mapping[str, Any]) -> None:
    """The one JSON object of ``--json``; not-a-number and infinity become null."""
    text = visible(json.dumps(plain(values), allow_nan=False, ensure_ascii=False)) + "\n"
    with undisturbed(), suppress(BrokenPipeError):  # as in `answer`
        if _json_file:
            with open(_json_file[-1], "w", encoding="utf-8", closefd=False) as file:
                file.write(text)
            _answered.append(_json_file[-1])
        else:
            print(text, end="", flush=True)


def has_answered() -> bool:
    """Whether the one JSON object has been printed."""
    return bool(_json_file) and _json_file[-1] in _answered


def next_command(*words: str | Path) -> str:
    """A command to type next, as a shell takes it: paths may hold spaces."""
    return shlex.join(["palpate", *map(str, words)])


def visible(text: str) -> str:
    """``text`` with what a terminal would obey written out, as in JSON: ``\\u001b``.

    Names and notes come from files and devices of others.
    """
    return "".join(c if c.isprintable() or c in "\n\t" else json.dumps(c)[1:-1] for c in text)


def plain(value: Any) -> Any:
    """``value`` as JSON knows it: no NaN, no numpy, no paths, no tuples."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if hasattr(value, "tolist"):  # arrays and numbers of numpy
        return plain(value.tolist())
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(one) for one in value]
    return value


def key_values(notes: Sequence[str], option: str = "--note") -> dict[str, str]:
    """``--note KEY=VALUE`` given any number of times. Raises `typer.BadParameter`."""
    pairs = [text.partition("=") for text in notes]
    for key, equals, value in pairs:
        if not (key and value):
            raise typer.BadParameter(f"{option} {key}{equals}{value}: say it as KEY=VALUE")
    return {key: value for key, _, value in pairs}


@contextmanager
def only_json() -> Iterator[None]:
    """Within: whatever prints goes to standard error, libraries in C included.

    Some clients of robots print to the process's standard output on their own; a JSON reader
    must not see that.
    """
    sys.stdout.flush()
    kept = os.dup(1)
    _json_file.append(kept)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        _json_file.remove(kept)
        _answered.clear()
        os.close(kept)
