"""A terminal that is gone: the scan and its file are not."""

import errno
import sys

import pytest

from probe.cli.say import inform


class Gone:
    """Standard error after its terminal was closed."""

    def write(self, _text: str) -> int:
        raise OSError(errno.EIO, "Input/output error")

    def flush(self) -> None:
        raise OSError(errno.EIO, "Input/output error")


def test_words_to_nobody_are_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Gone())
    inform("the scan was aborted")
