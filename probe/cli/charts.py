"""``palpate chart``: what the finite elements cost and where they end, measured on this machine."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from probe.cli.say import Json, answer, answer_json, inform

chart = typer.Typer(no_args_is_help=True, help="Chart the models: cost, error, limits.")
Out = Annotated[Path, typer.Option(metavar="DIR", help="Where the picture and its table go.")]


@chart.command()
def speed_accuracy(
    out: Out = Path("charts"),
    scene: Annotated[str, typer.Option(metavar="NAME|FILE", help="Which scene.")] = "TIHA",
    plane: Annotated[
        Literal["stress", "strain"] | None, typer.Option(help="Instead of the scene's own.")
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Times are medians of this many.")] = 3,
    json: Json = False,
) -> None:
    """Error against time for every model, element and mesh, beside CalculiX and FElupe."""
    from probe.studies.charts.speed_accuracy import chart as measure

    table = measure(out, scene, repeats, inform, plane)
    shown = table[table.reason == ""].sort_values("processor_s")
    if json:
        answer_json({"out": out, "rows": table.fillna("").to_dict("records")})
        return
    for row in shown.itertuples():
        errors = f"force {row.force_error_pct:.3f} %, pulse {row.pulse_error_pct:.2f} %"
        mesh = f"{row.element:22} {row.size_mm:4.2f} mm"
        answer(f"{row.solver:24} {mesh} {row.processor_s:8.3f} s: {errors}")
    answer(f"{out / 'speed-accuracy.png'}")


@chart.command()
def stability(
    out: Out = Path("charts"),
    quick: Annotated[bool, typer.Option("--quick", help="Every fifth cell only.")] = False,
    json: Json = False,
) -> None:
    """Go where methods fail, and draw what is solved, what is refused, and why.

    Each cell is stored in stability.csv when it is solved. An interrupted run continues from
    there; take another DIR, or delete the table, to begin again.
    """
    from probe.studies.charts.stability import chart as solve

    table = solve(out, quick, inform)
    counts = {str(verdict): int(n) for verdict, n in table.verdict.value_counts().items()}
    if json:
        answer_json({"out": out, "cells": len(table), **counts})
        return
    for row in table[table.verdict == "refused"].itertuples():
        inform(f"{row.family} {row.value}: {row.reason}")
    answer(", ".join(f"{count} {verdict}" for verdict, count in counts.items())
           + f" of {len(table)} cells: {out / 'stability.png'}")  # fmt: skip
