"""The command line with all its commands, and what runs one of them.

A file of commands imports at its top only what its options need; the work itself is imported by
the command that does it, so that ``palpate --help`` is quick.
"""

import os
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from importlib import import_module
from keyword import iskeyword
from pathlib import Path
from typing import Annotated

import typer

from probe.cli import say, undisturbed
from probe.cli.errors import status_of
from probe.cli.layout import COMMANDS, Grouped
from probe.cli.logs import log_to

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
"""The solves are small: threads that wait for each other cost up to four times what they save."""
HELP = frozenset(("-h", "--help"))


def build() -> typer.Typer:
    """The whole command line."""
    app = typer.Typer(
        name="palpate",
        cls=Grouped,
        help="Press a probe into soft tissue, on a rig or a phantom, and say what lies beneath.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": sorted(HELP)},
        epilog="Exit status: 0 done, 2 bad input, 3 device or safety fault, 4 physics not solved, "
        "5 aborted or stopped by the user, 70 a mistake of palpate itself.",
    )
    app.callback()(_options)
    for name, (file, example) in COMMANDS.items():
        function = f"{name}_" if iskeyword(name) else name
        command = getattr(import_module(f"probe.cli.{file}"), function)
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            app.command(name, epilog=f"Example: {example}")(command)
    return app


def run(given: Sequence[str]) -> int:
    """Run one command; the exit status. Never shows a stack trace for what a user can correct."""
    say.keep_streams()
    for threads in ONE_THREAD:  # before numpy is imported; a user's own setting stands
        os.environ.setdefault(threads, "1")
    as_json = "--json" in given
    with say.only_json() if as_json else nullcontext():
        try:
            status = typer.main.get_command(build()).main(
                list(given), prog_name="palpate", standalone_mode=False
            )
        except SystemExit as error:  # typer's way to end where nobody reads on
            helps = not given or not HELP.isdisjoint(given)
            status = 0 if helps else error.code if isinstance(error.code, int) else 1
        except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - the one place for all
            with undisturbed():
                status, text = status_of(error)
                if text:
                    say.inform(text)
                    if as_json and not say.has_answered():
                        with suppress(OSError):  # what was wrong may be that nothing can be written
                            say.answer_json({"error": text, "status": status})
    return status if isinstance(status, int) else 0


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        say.answer(f"palpate {version('palpate')}")
        raise typer.Exit


def _options(
    version: Annotated[  # noqa: ARG001 - its callback prints it
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", is_eager=True, callback=_print_version
        ),
    ] = False,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write everything that happens to this file too."),
    ] = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Tell everything that happens, not only notes.")
    ] = False,
) -> None:
    """What every command understands."""
    log_to(log, verbose=verbose)
