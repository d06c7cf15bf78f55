"""``palpate runs``: a folder of runs, listed, filtered and sorted."""

from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from probe.cli.say import Json, answer, answer_json, answer_table, key_values

if TYPE_CHECKING:  # commands import what they need when they run
    from probe.storage.collection import Listed

Finding = Literal["nothing", "tumour", "artery", "stenotic artery", "undecided", "cannot see"]
WIDTHS = {"date": 10, "scene": 5, "how": 9, "finish": 9, "who and what": 12, "finding": 15}
"""Characters that each column of the table of runs needs."""
By = Literal["date", "scene", "operator", "specimen", "finding", "name"]


def runs(
    folder: Annotated[Path, typer.Argument(metavar="[DIR]", help="Where the runs are.")] = Path(
        "runs"
    ),
    finding: Annotated[Finding | None, typer.Option(help="Only runs with this finding.")] = None,
    scene: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only runs of this scene.")
    ] = None,
    operator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only runs by this operator.")
    ] = None,
    specimen: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only runs of this specimen.")
    ] = None,
    note: Annotated[
        list[str] | None, typer.Option(metavar="KEY=VALUE", help="Only runs with this note.")
    ] = None,
    since: Annotated[
        str | None, typer.Option(metavar="DATE", help="Only runs from this day on, say 2026-01-31.")
    ] = None,
    simulated: Annotated[
        bool | None, typer.Option("--simulated/--real", help="Only simulated, or only real, runs.")
    ] = None,
    sort: Annotated[By, typer.Option(help="What to sort by.")] = "date",
    findings: Annotated[
        bool, typer.Option("--findings", help="Detect in each run and show what was found.")
    ] = False,
    json: Json = False,
) -> None:
    """List the runs of a folder and those below it."""
    from probe.storage.collection import list_runs

    if not folder.is_dir():
        what = "a file; give the folder it is in" if folder.exists() else "no such folder"
        raise typer.BadParameter(f"{folder}: {what}")
    if since is not None and not _is_date(since):
        raise typer.BadParameter(f"--since {since}: say it as 2026-01-31")
    wanted = {"operator": operator, "specimen": specimen, **key_values(note or [])}
    kept = [
        one
        for one in list_runs(folder)
        if (scene is None or one.scene == scene)
        and (simulated is None or one.simulated == simulated)
        and (since is None or one.started_utc >= since)
        and all(value is None or one.labels.get(key) == value for key, value in wanted.items())
    ]
    found: dict[Path, str] = {}
    if findings or finding is not None or sort == "finding":
        found = {one.path: _finding(one) for one in kept}
        kept = [one for one in kept if finding is None or found[one.path] == finding]
    kept.sort(key=lambda one: _place(one, sort, found))
    if json:
        answer_json({"runs": [asdict(one) | {"finding": found.get(one.path)} for one in kept]})
        return
    show(kept, found)


def _is_date(text: str) -> bool:
    try:
        datetime.fromisoformat(text)
    except ValueError:
        return False
    return True


def _finding(one: "Listed") -> str:
    """What detection says; nothing for a run without a complete station."""
    from probe.detection import detect
    from probe.storage.run import open_run

    if one.problem:
        return ""
    recording = open_run(one.path).recording()
    return str(detect(recording).as_json()["finding"]) if recording.stations else ""


def _place(one: "Listed", sort: By, found: dict[Path, str]) -> tuple[str, str, str]:
    keys: dict[str, str] = {
        "date": one.started_utc,
        "scene": one.scene,
        "finding": found.get(one.path, ""),
        "name": one.path.name,
    }
    return keys.get(sort, one.labels.get(sort, "")), one.started_utc, str(one.path)


def show(runs: "list[Listed]", found: dict[Path, str]) -> None:
    """A table with a line per run."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    if not runs:
        answer("no runs")
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    labelled = any(one.labels for one in runs)
    left_out = {"who and what": not labelled, "finding": not found}
    table.add_column("run", no_wrap=True)  # whole, to be copied into the next command
    heads = [head for head in WIDTHS if not left_out.get(head)]
    for head in heads:
        table.add_column(head, overflow="fold", min_width=WIDTHS[head])
    for one in runs:
        labels = ", ".join(v if k in ("operator", "specimen") else f"{k}={v}"
                           for k, v in one.labels.items())  # fmt: skip
        cells: list[Any] = [
            str(one.path),
            one.started_utc[:16].replace("T", " "),
            one.scene,
            "" if one.problem else "simulated" if one.simulated else "real",
            one.problem or one.finish or "not finished",
            *[labels] * labelled,
        ]
        table.add_row(*cells, *([found[one.path]] if found else []))
    console = Console()
    longest = max(len(str(one.path)) for one in runs)
    needed = longest + sum(WIDTHS[head] for head in heads) + 3 * len(heads) + 2
    roomy = 0 if console.is_terminal else 1000  # a file or a pipe has no width: nothing is folded
    console.width = max(console.width, needed, roomy)  # else long paths would be cut
    answer_table(console, table)
