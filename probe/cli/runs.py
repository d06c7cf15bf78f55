"""Stored runs: check, export, import, watch, replay and report them."""

from pathlib import Path
from typing import Annotated

import typer

from probe.cli.errors import BAD_INPUT
from probe.cli.finding import RunFile
from probe.cli.say import Json, answer, answer_json
from probe.cli.windows import need_windows


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command()(replay)
    app.command()(live)
    app.command()(report)
    app.command()(verify)


def replay(
    run: RunFile,
    live: Annotated[bool, typer.Option("--live", help="Replay in a window.")] = False,
    beside: Annotated[
        Path | None, typer.Option(metavar="RUN", help="Another run, in step beside it.")
    ] = None,
) -> None:
    """Tell what happened in a run, event by event, or play it in a window."""
    if live or beside is not None:
        need_windows()
        from probe.live.app import run_replay

        raise typer.Exit(run_replay(run, beside))
    from probe.cli.history import lines
    from probe.run import open_run

    for line in lines(open_run(run).events()):
        answer(line)


def live(run: RunFile) -> None:
    """Watch a run in a window while it is scanned; pause, resume, abort and stop it there."""
    need_windows()
    from probe.live.app import run_live

    raise typer.Exit(run_live(run))


def report(
    run: RunFile,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where to write; by default RUN-report.")
    ] = None,
    json: Json = False,
) -> None:
    """Write one self-contained HTML page and its figures."""
    from probe.report import write_report

    page = write_report(run, out or run.with_name(f"{run.stem}-report"))
    if json:
        answer_json({"run": run, "report": page})
    else:
        answer(f"Report: {page}")


def verify(run: RunFile, json: Json = False) -> None:
    """Check that a run file is whole: every sample, checksum, order and label."""
    from probe.verify import verify as check

    found = check(run)
    if json:
        answer_json(found.as_json())
    else:
        for problem in found.problems:
            answer(f"PROBLEM  {problem}")
        samples = ", ".join(f"{n} of {device}" for device, n in found.samples.items())
        answer(
            f"{run}: {found.events} events, {found.stations_complete} of "
            f"{found.stations_planned} stations complete, samples: {samples}"
        )
        for device, lost in found.lost.items():
            if lost:
                answer(f"{device}: {lost} samples are known to be lost")
        answer("The file is sound." if found.ok else "The file is damaged.")
    raise typer.Exit(0 if found.ok else BAD_INPUT)
