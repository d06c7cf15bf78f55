"""Where the logger ``palpate`` writes while a command runs: the terminal, and a file if asked."""

import logging
import sys
from pathlib import Path

WORDS = {logging.ERROR: "fault"}
FILE_FORMAT = "%(asctime)s %(levelname)s %(message)s"


class _AsTold(logging.Formatter):
    """``warning: DEVICE: TEXT``, as a person at the terminal reads it."""

    def format(self, record: logging.LogRecord) -> str:
        word = WORDS.get(record.levelno, record.levelname.lower())
        return f"{word}: {record.getMessage()}"


class _Terminal(logging.StreamHandler):  # type: ignore[type-arg]
    """Standard error as it is when a line is written: ``--json`` and tests redirect it."""

    def __init__(self) -> None:
        super().__init__(sys.stderr)
        self.setFormatter(_AsTold())
        self.last_fault = ""

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.ERROR:
            self.last_fault = record.getMessage()
        self.stream = sys.stderr
        super().emit(record)


def already_reported(reason: str) -> bool:
    """Whether the terminal's last fault was this one."""
    shown = [one for one in logging.getLogger("palpate").handlers if isinstance(one, _Terminal)]
    return any(one.last_fault.endswith(reason) for one in shown)


def log_to(file: Path | None, *, verbose: bool) -> None:
    """Notes go to standard error (with ``verbose``, everything), and everything to ``file``."""
    logger = logging.getLogger("palpate")
    for handler in logger.handlers[:]:  # of an earlier command in this process
        if not isinstance(handler, logging.NullHandler):
            logger.removeHandler(handler)
            handler.close()
    logger.setLevel(logging.DEBUG)
    terminal = _Terminal()
    terminal.setLevel(logging.DEBUG if verbose else logging.INFO)
    logger.addHandler(terminal)
    # who may not write to their home need not read where matplotlib keeps its cache
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    if file is not None:
        kept = logging.FileHandler(file, encoding="utf-8")
        kept.setFormatter(logging.Formatter(FILE_FORMAT))
        logger.addHandler(kept)
