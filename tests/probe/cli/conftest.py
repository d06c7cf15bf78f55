"""The command line, run in this process; scans answer from springs unless a test says otherwise."""

import json
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from probe.cli import main


@dataclass(frozen=True)
class Outcome:
    """What one command did."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """Standard output as one strict JSON object."""

        def refuse(word: str) -> None:
            raise ValueError(f"{word} is not JSON")

        value = json.loads(self.out, parse_constant=refuse)
        assert isinstance(value, dict)
        return value


Palpate = Callable[..., Outcome]


@pytest.fixture(autouse=True)
def _log_handlers_end_with_their_command() -> Iterator[None]:
    """A command's process ends; here its terminal would go on telling what later tests do."""
    yield
    logger = logging.getLogger("palpate")
    for handler in logger.handlers[:]:
        if not isinstance(handler, logging.NullHandler):
            logger.removeHandler(handler)
            handler.close()


@pytest.fixture
def palpate(capfd: pytest.CaptureFixture[str]) -> Palpate:
    """Run one command, which is to end with ``status``."""

    def run(*arguments: str | Path, status: int | None = None) -> Outcome:
        capfd.readouterr()
        ended = main([str(one) for one in arguments])
        done = Outcome(ended, *capfd.readouterr())
        assert status in (None, ended), done
        return done

    return run


@pytest.fixture
def springs(monkeypatch: pytest.MonkeyPatch, winkler: Callable[..., Any]) -> None:
    """Tissue of springs in place of the finite elements: these tests are about the commands."""
    monkeypatch.setattr("sim_backend.models.station_response.respond", winkler)
    monkeypatch.setattr(
        "sim_backend.models.ahead.processors", lambda: 1
    )  # it solves finite elements
