"""``palpate --help`` is grouped and complete; each command's help has an example that parses."""

import re
import shlex
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from paths import ROOT

from drivers.core.registry import settings_of
from probe.cli import main
from probe.cli.command_line import build
from probe.cli.layout import EXAMPLES, SECTIONS
from probe.config.load_rig import load_rig


def test_every_command_stands_in_one_section() -> None:
    listed = [name for each in SECTIONS.values() for name in each]
    assert sorted(listed) == sorted(typer.main.get_command(build()).commands)


def test_help_is_grouped(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    places = [text.index(f"{title}:") for title in SECTIONS]
    assert places == sorted(places)
    assert "5 aborted" in text


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_is_shown_and_parses(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = shlex.split(EXAMPLES[name])
    assert words[:2] == ["palpate", name]
    command = typer.main.get_command(build())
    rest = words[1:]
    while hasattr(command, "commands"):  # a group: its example names a command of it
        command, rest = command.commands[rest[0]], rest[1:]
    command.make_context(rest[0] if rest else name, list(rest))
    if name != "chart":
        assert main([name, "--help"]) == 0
        assert f"Example: {EXAMPLES[name]}" in " ".join(capsys.readouterr().out.split())


def helps(command: Any, words: tuple[str, ...] = ("palpate",)) -> Iterator[tuple[str, str]]:
    """Every command's words and help, groups and their commands included."""
    yield " ".join(words), command.get_help(command.context_class(command, info_name=words[-1]))
    for name, one in getattr(command, "commands", {}).items():
        yield from helps(one, (*words, name))


def test_no_help_shows_a_type_of_python() -> None:
    found = dict(helps(typer.main.get_command(build())))
    assert {"palpate", "palpate sweep", "palpate chart stability"} <= set(found)
    of_python = re.compile(
        r"<(?:[^<>]* range|path)>|\b(?:list|dict|tuple)\[|\b(?:str|int|float|bool)\b"
    )
    reported = {words: of_python.findall(text) for words, text in found.items()}
    assert {words: types for words, types in reported.items() if types} == {}
    assert "--seed NUMBER" in found["palpate scan"]
    assert "<rig|scene|driver>" in found["palpate init"]  # what may be chosen stays


def test_the_rig_that_record_is_shown_with_can_be_recorded() -> None:
    """A relay takes a line, or a host with one port; a UR arm has several."""
    rig = load_rig(ROOT / shlex.split(EXAMPLES["record"])[2])
    real = [one for one in rig.sensor if one.driver != "virtual"]
    assert real
    assert rig.stage.driver == "virtual"  # one that must be homed first would be moved
    for one in real:
        keys = settings_of("sensors", one.driver).model_fields
        assert "port" in one.settings or {"host", "tcp_port"} <= set(keys), one.driver
