"""Stored runs: check, export, import, watch, replay and report them."""

from pathlib import Path
from typing import Annotated

import typer

from probe.cli.arguments import RunFiles
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
        from probe.gui.app import run_replay

        raise typer.Exit(run_replay(run, beside))
    from probe.cli.history import lines
    from probe.storage.run import open_run

    for line in lines(open_run(run).events()):
        answer(line)


def live(run: RunFile) -> None:
    """Watch a run in a window while it is scanned; pause, resume, abort and stop it there."""
    need_windows()
    from probe.gui.app import run_live

    raise typer.Exit(run_live(run))


def report(
    runs: RunFiles,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where to write; by default RUN-report.")
    ] = None,
    anonymous: Annotated[
        bool, typer.Option("--anonymous", help="Leave out who, where and when.")
    ] = False,
    json: Json = False,
) -> None:
    """Write one self-contained HTML page and its figures, for each run given."""
    from probe.report import write_report

    written = []
    for n, run in enumerate(runs):
        name = f"report-{n + 1}" if anonymous else f"{run.stem}-report"
        folder = run.with_name(name) if out is None else out / name if len(runs) > 1 else out
        written.append({"run": run, "report": write_report(run, folder, without_names=anonymous)})
    if json:
        answer_json(written[0] if len(written) == 1 else {"reports": written})
        return
    for one in written:
        answer(f"Report: {one['report']}")


def verify(runs: RunFiles, json: Json = False) -> None:
    """Check that run files are whole: every sample, checksum, order and label."""
    from probe.storage.verify import verify as check

    checked = [(run, check(run)) for run in runs]
    if json:
        findings = [{"run": run, **found.as_json()} for run, found in checked]
        answer_json(findings[0] if len(findings) == 1 else {"runs": findings})
    for run, found in () if json else checked:
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
    raise typer.Exit(0 if all(found.ok for _, found in checked) else BAD_INPUT)
