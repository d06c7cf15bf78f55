"""``palpate detect`` and ``palpate compare``: what a stored run means."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from probe.cli.say import Json, answer, answer_json, plain

MOST_LINES = 40
RunFile = Annotated[Path, typer.Argument(metavar="RUN", help="A run file.")]


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command()(detect)
    app.command()(compare)


def detect(
    run: RunFile,
    false_alarm: Annotated[
        float, typer.Option(help="Allowed chance of a finding where nothing lies.")
    ] = 0.01,
    json: Json = False,
) -> None:
    """Say what lies beneath, and where, from a stored run."""
    from probe.run import open_run

    began_s = time.perf_counter()
    found = finding_json(run, open_run(run).recording(), began_s, false_alarm)
    if json:
        answer_json(found)
    else:
        show_finding(found)


def compare(
    run_a: Annotated[Path, typer.Argument(metavar="RUN_A", help="A run file.")],
    run_b: Annotated[Path, typer.Argument(metavar="RUN_B", help="Another run file.")],
    json: Json = False,
) -> None:
    """Say which of two runs has the diseased artery: the stiffer one with the weaker pulse."""
    from probe.detect import compare as compare_recordings
    from probe.run import open_run

    both = compare_recordings(open_run(run_a).recording(), open_run(run_b).recording())
    told = plain(both.as_json())
    if json:
        answer_json(told)
        return
    ratios = ", ".join(
        f"{name} {told[key]:.3g}" if told[key] is not None else f"{name} unknown"
        for name, key in (("peak A/B", "peak_ratio"), ("pulse A/B", "pulse_ratio"))
    )
    answer(f"diseased: {told['diseased']} ({ratios}; confidence {_percent(told['confidence'])})")


def finding_json(
    run_path: Path, recording: Any, began_s: float, false_alarm: float = 0.01
) -> dict[str, Any]:
    """The JSON object of ``scan`` and ``detect``."""
    from probe.detect import detect as detect_in

    found = detect_in(recording, false_alarm=false_alarm).as_json()
    told: dict[str, Any] = plain(
        {
            "run": run_path,
            **found,
            "finish": recording.finish,
            "simulated": recording.simulated,
            "seconds": time.perf_counter() - began_s,
        }
    )
    return told


def show_finding(found: Mapping[str, Any]) -> None:
    """The stations as a compact table, then what lies beneath."""
    if len(found["stations"]) <= MOST_LINES:
        show_stations(found["stations"])
    else:
        answer(f"{len(found['stations'])} stations: the report shows them as a map")
    if found["simulated"]:
        answer(f"SIMULATED: {', '.join(found['simulated'])}")
    answer(f"Finding: {found['finding']}")
    for one in found["objects"]:
        low, high = one.get("position_ci_mm") or (None, None)
        between = f"{_number(low, '.2f')} to {_number(high, '.2f')}"
        peak, pulse = _number(one["peak_pa"], ".0f"), _number(one["pulse_pa"], ".1f")
        answer(
            f"  {one['kind']} at x = {_number(one['position_mm'], '.2f')} mm (95 %: {between}), "
            f"peak {peak} Pa, pulse {pulse} Pa, confidence {_percent(one['confidence'])}"
        )
    if found.get("reason"):
        answer(f"  {found['reason']}")


def show_stations(stations: Sequence[Mapping[str, Any]]) -> None:
    """A table with a line per station."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for head in ("x mm", "baseline Pa", "pulse Pa"):
        table.add_column(head, justify="right")
    for one in stations:
        table.add_row(
            _number(one["x_mm"], ".1f"),
            _number(one["baseline_pa"], ".0f"),
            _number(one["pulse_pa"], ".1f"),
        )
    Console(width=80).print(table)


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _percent(value: float | None) -> str:
    return "unknown" if value is None else f"{100 * value:.0f} %"
