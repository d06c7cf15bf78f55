"""Ctrl-C, Ctrl-\\ and what a closing terminal sends: a command ends in words, once."""

import json
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
from programs import PALPATE, begun

from probe.cli import say

PRESS = ["press", "TIHA", "--x", "32", "--depth", "1", "--json"]


@pytest.fixture(autouse=True)
def orders_heard() -> Iterator[None]:
    """As at a terminal, also where whoever runs the tests has hangups or Ctrl-\\ ignored."""
    before = {n: signal.signal(n, signal.SIG_DFL) for n in (signal.SIGHUP, signal.SIGQUIT)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("slow, command, order", [
    ("typer", ["--help"], signal.SIGINT),
    ("pydantic", PRESS, signal.SIGINT),  # by typer, while it reads the options
    ("scipy", PRESS, signal.SIGINT),
    ("scipy", PRESS, signal.SIGTERM),
    ("scipy", PRESS, signal.SIGHUP),
    ("scipy", PRESS, signal.SIGQUIT),
])  # fmt: skip
def test_an_order_to_end_while_a_command_is_loaded_ends_it_in_a_line(
    tmp_path: Path, slow: str, command: list[str], order: signal.Signals
) -> None:
    """``slow`` is what it is loading: a library that takes half a minute."""
    (tmp_path / f"{slow}.py").write_text(
        "import sys, time\nprint('loading', file=sys.stderr, flush=True)\ntime.sleep(30)\n"
    )
    with begun(*command, env={**os.environ, "PYTHONPATH": str(tmp_path)}) as process:
        assert process.stderr.readline() == "loading\n"
        process.send_signal(order)
        out, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (5, "stopped\n")
    assert not out or json.loads(out) == {"error": "stopped", "status": 5}
    assert bool(out) == ("--json" in command)


def test_a_hangup_that_nohup_had_ignored_ends_no_command(tmp_path: Path) -> None:
    (tmp_path / "scipy.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGHUP)\nos._exit(42)\n"
    )
    done = subprocess.run(
        ["nohup", *PALPATE, *PRESS], env={**os.environ, "PYTHONPATH": str(tmp_path)},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 42, done.stderr


def test_an_order_to_end_while_an_end_is_reported_costs_no_answer(
    palpate: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(say, "inform", lambda _text: os.kill(os.getpid(), signal.SIGINT))
    ended = palpate("detect", "nowhere.run", "--json")
    assert (ended.status, json.loads(ended.out)["status"]) == (2, 2)


def test_an_order_to_end_after_the_answer_adds_no_other(
    palpate: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    app = typer.Typer()

    @app.command()
    def _answers(as_json: Annotated[bool, typer.Option("--json")] = False) -> None:
        say.answer_json({"as_json": as_json})
        raise typer.Abort

    monkeypatch.setattr("probe.cli.command_line.build", lambda: app)
    for _ in range(2):  # and the next command has its own
        ended = palpate("--json")
        assert (ended.status, json.loads(ended.out)) == (5, {"as_json": True})
