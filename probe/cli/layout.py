"""How ``palpate --help`` is laid out, and an example for each command's own help."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from typer.core import TyperGroup

from probe.cli.errors import Stopped

SECTIONS: dict[str, dict[str, tuple[str, str]]] = {
    "Scan": {
        "scan": ("scan", "palpate scan rigs/ur5e.toml --dry-run"),
        "resume": ("scan", "palpate resume runs/TIHA-20260101-120000.run"),
        "plan": ("rig", "palpate plan --scene TISA --can-i-see"),
        "live": ("runs", "palpate live runs/TIHA-20260101-120000.run"),
    },
    "Runs": {
        "detect": ("finding", "palpate detect runs/*.run"),
        "compare": ("finding", "palpate compare HEALTHY.run STENOTIC.run"),
        "twin": ("finding", "palpate twin runs/TIT-20260101-120000.run --out twin.toml"),
        "report": ("runs", "palpate report runs/TIHA-20260101-120000.run --anonymous"),
        "runs": ("collection", "palpate runs runs --finding artery --sort scene"),
        "replay": ("runs", "palpate replay runs/TIHA-20260101-120000.run --live"),
        "verify": ("runs", "palpate verify runs/*.run"),
        "export": ("exchange", "palpate export runs/*.run --to csv,mcap --out shared"),
        "import": ("exchange", "palpate import FORCE.csv --out FORCE.run --face-mm2 100"),
    },
    "Phantom": {
        "press": ("press", "palpate press TIHA --x 32 --depth 2.5"),
        "feel": ("scenes", "palpate feel --scene TISA"),
        "scenes": ("scenes", "palpate scenes TIHA"),
        "touch": ("touch", "palpate touch TIHA"),
        "emulate": ("emulate", "palpate emulate ur ft300 --scene TIHA"),
    },
    "Calibration": {
        "calibrate": ("calibrate", "palpate calibrate force LOADS.csv --device ft300"),
    },
    "Studies": {
        "sweep": ("studies", "palpate sweep TIHA --vary wall_mm=0.3..0.9:7 --out walls.csv"),
        "fleet": ("studies", "palpate fleet 20 --seed 1 --out fleet.csv"),
        "paper": ("studies", "palpate paper --out paper"),
        "chart": ("charts", "palpate chart stability --quick"),
    },
    "Rig": {
        "init": ("files", "palpate init rig mylab"),
        "schema": ("files", "palpate schema rig"),
        "doctor": ("rig", "palpate doctor rigs/ur5e.toml"),
        "teach": ("teach", "palpate teach rigs/ur5e.toml --write"),
        "watch": ("watch", "palpate watch rigs/ur5e.toml"),
        "record": (
            "record",
            "palpate record rigs/modbus_taxels.toml --out tests/drivers/exchanges",
        ),
    },
}
"""Every command under its section: the file that has it, and one example."""
COMMANDS = {name: said for each in SECTIONS.values() for name, said in each.items()}
EXAMPLES = {name: example for name, (_, example) in COMMANDS.items()}


KINDS = {
    "str": "TEXT", "list[str]": "TEXT", "path": "PATH", "Path": "PATH", "list[Path]": "PATH",
    "int": "NUMBER", "int range": "NUMBER", "float": "NUMBER", "float range": "NUMBER",
    "list[float]": "NUMBER",
}  # fmt: skip
"""What a person types, for each kind of value that typer would show as a type of Python."""


class Grouped(TyperGroup):
    """Lists the commands under the headings of `SECTIONS`."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        _without_types(self)

    # Typer makes a bare exit status of Ctrl-C, without what was said to be kept.
    def make_context(self, *given: Any, **more: Any) -> Any:
        with _stopped_in_words():
            return super().make_context(*given, **more)

    def invoke(self, ctx: Any) -> Any:
        with _stopped_in_words():
            return super().invoke(ctx)

    # What click gives it: click itself or the copy in typer, by typer's version.
    def format_commands(self, _ctx: Any, formatter: Any) -> None:
        widest = max(len(name) for name in self.commands)
        for title, commands in SECTIONS.items():
            rows = [
                (name.ljust(widest), self.commands[name].get_short_help_str(200))
                for name in commands
                if name in self.commands
            ]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


@contextmanager
def _stopped_in_words() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as stopped:
        raise Stopped(str(stopped)) from None


def _without_types(command: Any) -> None:
    """Say what is typed instead of a type: of an option `KINDS`, of an argument its name is enough.

    Of an older typer, which shows no types, nothing is changed.
    """
    for one in getattr(command, "commands", {}).values():
        _without_types(one)
    for parameter in command.params:
        shown = getattr(parameter, "display_type_rich", None)
        kind = str(shown(ctx=command.context_class(command))).strip("<>") if shown else ""
        if kind in KINDS and parameter.param_type_name == "argument":
            parameter.display_type_rich = _nothing
        elif kind in KINDS:
            parameter.metavar = KINDS[kind]


def _nothing(ctx: Any) -> str:  # noqa: ARG001 - typer names it
    return ""
