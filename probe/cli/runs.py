"""Stored runs: check, export, import, watch, replay and report them."""

from pathlib import Path
from typing import Annotated, Any

import typer

from probe.cli.arguments import RunFile, RunFiles
from probe.cli.errors import BAD_INPUT
from probe.cli.say import Json, answer, inform
from probe.cli.several import of_each
from probe.cli.windows import need_windows


def replay(
    run: RunFile,
    live: Annotated[bool, typer.Option("--live", help="Replay in a window.")] = False,
    beside: Annotated[
        Path | None, typer.Option(metavar="RUN", help="Another run, in step beside it.")
    ] = None,
) -> None:
    """Print the events of a run, or play it in a window."""
    if live or beside is not None:
        need_windows()
        from probe.gui.app import run_replay

        raise typer.Exit(run_replay(run, beside))
    from probe.cli.history import lines
    from probe.storage.run import open_run

    for line in lines(open_run(run).events()):
        if not answer(line):
            break


def live(run: RunFile) -> None:
    """Watch a run in a window while it is scanned; pause, resume, abort and stop it there."""
    if run.exists():  # one that is not there yet is waited for
        _need_run(run)
    need_windows()
    if not run.exists():
        inform(f"Waiting for {run}, which is not there yet; Ctrl-C ends it")
    from probe.gui.app import run_live

    raise typer.Exit(run_live(run))


def _need_run(path: Path) -> None:
    """Raises `RunFileError` for what is no run, nor will be: a scan makes its file in an instant,
    and may store its first event seconds later."""
    from probe.storage.run import NotBegun, open_run

    try:
        open_run(path)
    except NotBegun:
        if not path.stat().st_size:
            raise


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

    numbers = {run: n + 1 for n, run in enumerate(runs)}

    def write(run: Path) -> dict[str, Any]:
        name = f"report-{numbers[run]}" if anonymous else f"{run.stem}-report"
        folder = run.parent / name if out is None else out / name if len(runs) > 1 else out
        page = write_report(run, folder, without_names=anonymous)
        if not json:
            answer(f"Report: {page}")
        return {"run": run, "report": page}

    _, status = of_each(runs, write, json=json, together="reports" if len(runs) > 1 else "")
    raise typer.Exit(status)


def verify(runs: RunFiles, json: Json = False) -> None:
    """Check that run files are whole: every sample, checksum, order and label."""
    from probe.storage.verify import verify as check

    def look(run: Path) -> dict[str, Any]:
        found = check(run)
        if not json:
            _show_check(run, found)
        return {"run": run, **found.as_json()}

    found, status = of_each(runs, look, json=json)
    raise typer.Exit(status if all(one.get("ok") for one in found) else BAD_INPUT)


def _show_check(run: Path, found: Any) -> None:
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
