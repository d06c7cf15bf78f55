"""``palpate scan`` and ``palpate resume``: the main job."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from probe.cli import ABORTED
from probe.cli.arguments import (
    Fallback,
    RunFile,
    SceneName,
    planner_names,
    station_numbers,
    storable,
)
from probe.cli.errors import FAULT
from probe.cli.logs import already_reported
from probe.cli.say import Json, answer, answer_json, inform, key_values, next_command
from probe.cli.windows import need_windows

if TYPE_CHECKING:  # commands import what they need when they run
    from probe.scan.event_bus import EventSink
    from probe.scan.session import ScanResult


RigFile = Annotated[
    Path | None,
    typer.Argument(metavar="[RIG.toml]", help="A rig file; without one, the simulated rig."),
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder for the run file.")]
Live = Annotated[bool, typer.Option("--live", help="Open a window; runs in real time.")]
RealTime = Annotated[
    bool, typer.Option("--real-time", help="Let a simulated rig take as long as a real one.")
]
Report = Annotated[bool, typer.Option("--report", help="Write the report too.")]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Any key of the rig file; may be given again.",
        callback=storable,
    ),
]  # fmt: skip

AFTER_A_SCAN = ("probe.detection", "probe.storage.run", "rich.table")
"""What a finding needs: 0.3 s to import, in which simulated stations are solved elsewhere."""


def scan(
    rig: RigFile = None,
    scene: SceneName = None,
    out: Out = Path("runs"),
    settings: Settings = None,
    stations: Annotated[
        str | None,
        typer.Option(metavar="5-9", help="Press only these of the stations, numbered from 1."),
    ] = None,
    plan: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The planner that chooses among the stations; by default all.",
            autocompletion=planner_names,
            callback=storable,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated sensors' noise.")] = 0,
    operator: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Who scans; kept in the run.", callback=storable),
    ] = None,
    specimen: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="What or who is scanned; kept in the run.", callback=storable
        ),
    ] = None,
    note: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE", help="Any other label; may be given again.", callback=storable
        ),
    ] = None,
    fallback: Fallback = None,
    live: Live = False,
    real_time: RealTime = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check everything, move nothing.")
    ] = False,
    lsl: Annotated[
        bool, typer.Option("--lsl", help="Publish force, pose and phase as LSL streams.")
    ] = False,
    report: Report = False,
    json: Json = False,
) -> None:
    """Scan station by station, store every sample, and say what lies beneath.

    --set changes any key of the rig file for this scan, as --set scan.pitch_mm=2.

    Ctrl-C lifts the probe and ends the run; a second one stops where it is.
    """
    if stations:
        numbers = station_numbers(stations, "--stations")
        settings = [*(settings or []), f"scan.only={numbers}"]
    if plan:
        settings = [*(settings or []), f"scan.planner={plan}"]
    changes = key_values(settings or [], "--set")
    if dry_run:
        from probe.cli.rig import show_dry_run

        raise typer.Exit(show_dry_run(rig, scene, out, json, changes))
    need_report(report)
    from probe.cli.progress import scan_progress
    from probe.config.changed_rig import changed
    from probe.config.scan_plan import plan_for
    from probe.guards.commands import Control, ctrl_c
    from probe.scan.session import resolve_rig
    from probe.scan.session import scan as scan_with

    began_s = time.perf_counter()
    labels = {"operator": operator, "specimen": specimen, **key_values(note or [])}
    whole = changed(resolve_rig(rig, scene)[0], changes)
    control = Control()
    shown = scan_progress(len(plan_for(whole).places))
    with keeping(live) as opened, ctrl_c(control), shown as progress:
        observers: list[EventSink] = [progress]
        if lsl:
            from probe.scan.lsl_publisher import LslPublisher

            observers.append(LslPublisher())
        scanned = scan_with(
            whole,
            out=out,
            seed=seed,
            labels={key: value for key, value in labels.items() if value},
            fallback=fallback,
            real_time=real_time or live,
            control=control,
            observers=observers,
            opened=opened,
        )
    status = print_result(scanned, began_s, report=report, as_json=json)
    raise typer.Exit(status)


def resume(
    run: RunFile,
    fallback: Fallback = None,
    live: Live = False,
    real_time: RealTime = False,
    report: Report = False,
    redo: Annotated[
        str | None,
        typer.Option(metavar="5-9", help="Press these stations again; the latest press counts."),
    ] = None,
    settings: Settings = None,
    trust: Annotated[
        bool, typer.Option(help="Open the devices that a run from another computer names.")
    ] = False,
    json: Json = False,
) -> None:
    """Go on with a run that was killed, aborted or broke off; complete stations stay.

    --redo presses stations again, with --set scan.indentation_mm=3 deeper.
    """
    need_report(report)
    from probe.cli.progress import scan_progress
    from probe.guards.commands import Control, ctrl_c
    from probe.scan.resume import resume as go_on
    from probe.scan.resume import unfinished

    began_s = time.perf_counter()
    again = tuple(station_numbers(redo, "--redo")) if redo else ()
    changes = key_values(settings or [], "--set")
    left, control = unfinished(run, again, changes), Control()
    total, done = len(left.plan.places), len(left.completed)
    with keeping(live) as opened, ctrl_c(control), scan_progress(total, done) as progress:
        scanned = go_on(
            run,
            fallback=fallback,
            real_time=real_time or live,
            control=control,
            observers=[progress],
            opened=opened,
            trust=trust,
            redo=again,
            settings=changes,
        )
    status = print_result(scanned, began_s, report=report, as_json=json)
    raise typer.Exit(status)


def need_report(wanted: bool) -> None:
    """Raises `MissingExtra` before anything moves, not when the scan is over."""
    from drivers.core.extras import require

    if wanted:
        require("matplotlib", "report", "--report")


@contextmanager
def keeping(live: bool) -> Iterator[Callable[[Path, Sequence[str]], None]]:
    """Yields what is to be called with the run file and the devices' notes when it is open.

    It says where the data are if the scan ends with an error, and opens the window if ``live``.
    """
    if live:
        need_windows()
    files: list[Path] = []

    def opened(path: Path, notes: Sequence[str]) -> None:
        files.append(path)
        for note in notes:
            inform(f"note: {note}")
        if live:
            open_window(path)
        for later in AFTER_A_SCAN:
            import_module(later)

    try:
        yield opened
    except BaseException:
        if files:
            inform(what_is_left(files[-1]))
        raise


def open_window(path: Path) -> None:
    """Start ``palpate live`` as a process of its own: its end or crash is not the scan's.

    In its own session, so that a Ctrl-C for the scan does not close the window.
    """
    command = [sys.executable, "-m", "probe.cli", "live", str(path)]
    subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)


def print_result(scanned: "ScanResult", began_s: float, *, report: bool, as_json: bool) -> int:
    """Say what the run found and how it ended; the exit status."""
    from probe.cli.finding import finding_json, show_finding
    from probe.core.events import Finish
    from probe.planning.planner import ALL
    from probe.storage.run import open_run

    path, ended, shown = scanned.path, scanned.ended, False
    try:
        recording = open_run(path).recording()
        found = finding_json(path, recording, began_s)
        if report and recording.stations:
            from probe.report import write_report

            found["report"] = str(write_report(path, path.with_name(f"{path.stem}-report")))
        if as_json:
            answer_json(found)
        else:
            show_finding(found)
            answer(f"Run: {path}")
            if recording.stations:  # without one there is nothing to report
                answer(f"Report: {found.get('report', next_command('report', path))}")
        shown = True
    finally:  # how the scan ended is said even if its file cannot be read now
        if ended.finish is not Finish.COMPLETED:
            how = f"The scan was {ended.reason}"
            if ended.finish is Finish.FAULTED:
                why = "this" if already_reported(ended.reason) else "a"
                how = f"{why} fault ended the scan".capitalize()
                how += "" if why == "this" else f": {ended.reason}"
            inform(f"{how}. {what_is_left(path)}")
            inform(f"To go on where it broke off: {next_command('resume', path)}")
            if ended.finish is Finish.FAULTED:
                inform("That goes on with the rig as it was; if the rig file was wrong, correct it "
                       "and begin a new scan.")  # fmt: skip
        elif not shown:
            inform(what_is_left(path))
        elif ended.reason != ALL:  # a planner left out some
            inform(f"The scan is done: {ended.reason}.")
    return {Finish.FAULTED: FAULT, Finish.ABORTED: ABORTED}.get(ended.finish, 0)


def what_is_left(path: Path) -> str:
    """Where what a scan has read is, once it was looked at, or what is left of it."""
    from probe.core.errors import RunFileError
    from probe.storage.verify import verify

    try:
        report = verify(path)
    except RunFileError as error:
        return f"What was read cannot be read now: {error}"
    if report.ok:
        return f"What was read is in {path}"
    return (
        f"Of what was read {report.events} events are left in {path}, which is damaged: "
        f"{report.problems[0].splitlines()[0]}"
    )
