"""The command's solves run on one thread, unless its user says otherwise."""

import os

import pytest

from probe.cli import main
from probe.cli.command_line import ONE_THREAD


@pytest.mark.parametrize(("own", "then"), [(None, "1"), ("4", "4")])
def test_one_thread_unless_set(own: str | None, then: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ONE_THREAD:
        monkeypatch.setenv(name, own or "")
        if own is None:
            monkeypatch.delenv(name)
    assert main(["--version"]) == 0
    assert [os.environ[name] for name in ONE_THREAD] == [then, then]
