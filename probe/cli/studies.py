"""``palpate sweep``, ``fleet`` and ``paper``: many presses or scans, and the paper's figures."""

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from probe.cli.arguments import SCENE, Accuracy, Workers
from probe.cli.errors import UNSOLVED
from probe.cli.say import Json, answer, answer_json, inform

if TYPE_CHECKING:
    import pandas as pd

Table = Annotated[
    Path, typer.Option(metavar="FILE", help="The table to write: .parquet, .csv or .h5.")
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler: many machines.")
]


def sweep(
    scene: Annotated[str, SCENE],
    vary: Annotated[
        list[str],
        typer.Option(metavar="KEY=VALUES", help="Values: 10,12,14 or 10..14:5 or 10..14 (random)."),
    ],
    design: Annotated[
        Literal["full", "zip", "lhs", "sobol"], typer.Option(help="How values are combined.")
    ] = "full",
    count: Annotated[int, typer.Option(help="Points of a random design.")] = 0,
    seed: Annotated[int, typer.Option(help="Seed of a random design.")] = 0,
    x: Annotated[
        str, typer.Option(metavar="MM", help="Places, 32 or 4..60:15; default: over the inclusion.")
    ] = "",
    depth: Annotated[float, typer.Option(metavar="MM", help="Indentation [mm].")] = 2.5,
    accuracy: Accuracy = 1.0,
    model: Annotated[
        Literal["auto", "finite", "small", "quick"],
        typer.Option(
            help="Model; quick: as a scan feels it, each place solved once for all depths and "
            "pressures."
        ),
    ] = "auto",
    out: Table = Path("sweep.parquet"),
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: Json = False,
) -> None:
    """Press or scan many variants of a scene; an interrupted sweep goes on where it stopped."""
    from probe.cli.progress import counting
    from probe.studies.sweep import sweep as run
    from probe.studies.vary import keys_and_values

    began_s = time.perf_counter()
    with counting("points") as progress:
        table = run(
            scene, keys_and_values(vary), out=out, design=design, count=count, seed=seed, x_mm=x,
            indentation_mm=depth, model=model, accuracy_pct=accuracy, workers=workers,
            scheduler=scheduler, progress=progress,
        )  # fmt: skip
    failed = table[table["reason"] != ""]
    rough, largest_pct = too_rough(table, accuracy)
    summary = {
        "table": out,
        "points": int(table["point"].nunique()),
        "rows": len(table),
        "failed": len(failed),
        "too_rough": rough,
        "largest_error_estimate_pct": largest_pct,
        "seconds": time.perf_counter() - began_s,
    }
    for _, row in failed.head(5).iterrows():
        inform(f"point {row['point']}: {row['reason']}")
    if rough:
        inform(
            f"{rough} of {len(table)} rows miss the accuracy of {accuracy:g} % that was asked for: "
            f"the largest stated error is {largest_pct:.2g} % (error_estimate_pct); "
            + what_is_finer(model)
        )
    if json:
        answer_json(summary)
    else:
        answer(f"{len(table)} rows, {len(failed)} without an answer: {out}")
    if len(failed) == len(table):
        raise typer.Exit(UNSOLVED)


def too_rough(table: "pd.DataFrame", accuracy_pct: float) -> tuple[int, float | None]:
    """How many rows of a sweep state an error above ``accuracy_pct``, and the largest error [%]
    that any states; None where no row has an answer."""
    if "error_estimate_pct" not in table:
        return 0, None
    stated_pct = table["error_estimate_pct"].dropna()
    largest_pct = float(stated_pct.max()) if len(stated_pct) else None
    return int((stated_pct > accuracy_pct).sum()), largest_pct


def what_is_finer(model: str) -> str:
    """What to do about rows that are too rough."""
    if model == "auto":
        return "no finer mesh would help: take the errors stated, or ask for less accuracy"
    if model == "quick":
        return "--accuracy does not steer --model quick: leave --model out for rows within it"
    return "leave --model out: then the cheapest model that is accurate enough is taken"


def fleet(
    count: Annotated[int, typer.Argument(help="Phantoms of each kind.", min=1)],
    seed: Annotated[int, typer.Option(help="Seed of the random phantoms.")] = 0,
    out: Table = Path("fleet.parquet"),
    workers: Workers = None,
    scheduler: Scheduler = None,
    json: Json = False,
) -> None:
    """Scan random phantoms of every kind, to train and test detectors on."""
    from probe.cli.progress import counting
    from probe.studies.fleet import fleet as run

    began_s = time.perf_counter()
    with counting("scans") as progress:
        table = run(
            count, out, seed=seed, workers=workers, scheduler=scheduler, progress=progress
        )  # fmt: skip
    failed = int((table["reason"] != "").sum())
    if json:
        seconds = time.perf_counter() - began_s
        answer_json({"table": out, "rows": len(table), "failed": failed, "seconds": seconds})
        return
    answer(f"{len(table)} rows, {failed} without an answer: {out}")


def paper(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where pictures and table go.")] = Path(
        "paper"
    ),
    json: Json = False,
) -> None:
    """Redo the paper: its figures, and each of its statements beside our numbers."""
    from probe.studies.paper import paper as redo

    began_s = time.perf_counter()
    statements = redo(out, inform)
    if json:
        found = [asdict(one) for one in statements]
        seconds = time.perf_counter() - began_s
        answer_json({"out": out, "statements": found, "seconds": seconds})
        return
    for one in statements:
        answer(f"{one.verdict}: {one.text}\n    {one.ours}")
    answer((out / "sensitivity.txt").read_text(encoding="utf-8"))
    inform(f"Pictures and tables: {out}")
