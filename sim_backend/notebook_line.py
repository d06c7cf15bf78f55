"""One line below a notebook's cell, written over: how far something long is. Nothing elsewhere."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


def in_notebook() -> bool:
    """Whether this is the kernel of a notebook."""
    return "ipykernel" in sys.modules


def rewritten() -> Callable[..., None]:
    """Writes a text over the one before it; with ``end="\\n"`` it stays."""
    width = 0

    def say(text: str, end: str = "") -> None:
        nonlocal width
        sys.stderr.write("\r" + text.ljust(width) + end)
        sys.stderr.flush()
        width = len(text)

    return say


@contextmanager
def notebook_line() -> Iterator[Callable[[str], None]]:
    """Within: says what it is given below the cell of a notebook; the line is empty afterwards."""
    if not in_notebook():
        yield lambda _text: None
        return
    say = rewritten()
    try:
        yield say
    finally:
        say("", "\r")
