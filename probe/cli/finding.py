"""``palpate detect``, ``compare`` and ``twin``: what a stored run means."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Annotated, Any

import typer

from probe.cli.arguments import RunFile, RunFiles, station_numbers
from probe.cli.say import Json, answer, answer_json, answer_table, plain
from probe.cli.several import of_each
from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.core.finding_words import number_words, percent, simulated_words, size_words, summary
from probe.core.places import has_rows

MAX_LINES = 40
PriorsFile = Annotated[
    Path | None,
    typer.Option(
        "--priors",
        metavar="FILE",
        help="TOML file of what is known beforehand, as diastolic_mmhg = [76, 80] by a cuff.",
    ),
]


def detect(
    runs: RunFiles,
    false_alarm: Annotated[
        float, typer.Option(help="Allowed chance of a finding where nothing lies.")
    ] = DEFAULT_FALSE_ALARM,
    ask: Annotated[
        float | None,
        typer.Option(
            "--ask",
            metavar="PA",
            help="Smallest pulse, trough to crest in Pa, that 'nothing' is to rule out; by default "
            "the paper's healthy artery on this probe's face.",
        ),
    ] = None,
    priors: PriorsFile = None,
    empty: Annotated[
        str | None,
        typer.Option(
            metavar="RUN|STATIONS",
            help="Presses over nothing, another run or stations of this one (1-8): say which "
            "presses are unlike them, in any unit.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Say what lies beneath, and where, from stored runs; one that cannot be read is named."""
    if not 0 < false_alarm < 1:
        raise typer.BadParameter(f"--false-alarm {false_alarm:g}: a chance between 0 and 1")
    if ask is not None and not 0 < ask < inf:
        raise typer.BadParameter(f"--ask {ask:g}: a pulse in Pa, more than 0")
    from probe.detection.priors import priors_of
    from probe.storage.run import open_run

    believed = priors_of(priors)

    def look(run: Path) -> dict[str, Any]:
        began_s = time.perf_counter()
        recording = open_run(run).recording(any_unit=True)
        one = finding_json(run, recording, began_s, false_alarm, ask, believed)
        if empty is not None:
            one = _unlike(one, recording, empty)
        if not json:
            if len(runs) > 1:
                answer(f"\n{run}")
            show_finding(one)
            if empty is not None:
                answer(_unlike_words(one, false_alarm))
        return one

    _, status = of_each(runs, look, json=json)
    raise typer.Exit(status)


def _unlike(found: Mapping[str, Any], recording: Any, empty: str) -> dict[str, Any]:
    """What --empty adds: ``empty``, how many presses over nothing at how many places there are, and
    ``stations`` with how unlike them each is; None of those that are themselves over nothing."""
    from probe.detection.unlike_empty import unlike_empty

    own = station_numbers(empty, "--empty") if set(empty) <= set("0123456789,- ") else []
    if missing := set(own) - {station.index + 1 for station in recording.stations}:
        raise typer.BadParameter(f"--empty {empty}: no complete station {min(missing)} in the run")
    others, empties = (
        replace(
            recording, stations=tuple(s for s in recording.stations if (s.index + 1 in own) is over)
        )
        for over in (False, True)
    )
    try:
        unlike = unlike_empty(others, empties if own else empty)
    except ValueError as error:
        raise typer.BadParameter(f"--empty {empty}: {error}") from None
    said = {
        station.index + 1: {"unlike_empty": distance, "unlike_empty_chance": chance}
        for station, distance, chance in zip(
            others.stations, unlike.distance, unlike.chance, strict=True
        )
    }
    unknown = {"unlike_empty": None, "unlike_empty_chance": None}
    stations = [press | said.get(press["station"], unknown) for press in found["stations"]]
    counted = {"presses": unlike.presses, "places": unlike.places}
    return dict(plain({**found, "stations": stations, "empty": counted}))


def _unlike_words(found: Mapping[str, Any], false_alarm: float) -> str:
    """Which stations are unlike presses over nothing, and how many would be by chance."""
    presses, places = found["empty"]["presses"], found["empty"]["places"]
    level = max(false_alarm, 1 / (presses + 1))
    chances = {press["station"]: press["unlike_empty_chance"] for press in found["stations"]}
    judged = {number: chance for number, chance in chances.items() if chance is not None}
    named = [str(number) for number, chance in judged.items() if chance <= level]
    more = f" and {len(named) - MAX_LINES} more" if len(named) > MAX_LINES else ""
    where = f"at {places} places" if places > 1 else "at one place: elsewhere they may differ"
    which = f": {', '.join(named[:MAX_LINES])}{more}" if named else ""
    return (
        f"Unlike {presses} presses over nothing ({where}), at a chance of {100 * level:.2g} % "
        f"each: {len(named)} of {len(judged)} stations ({level * len(judged):.2g} by chance){which}"
    )


def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN_A RUN_B", help="Two run files.")],
    json: Json = False,
) -> None:
    """Say what two runs of one place have in common: a stenosed artery, a lump that changed."""
    if len(runs) != 2:
        names = ", ".join(map(str, runs))
        raise typer.BadParameter(f"compare takes two runs, got {len(runs)}: {names}; name two")
    if runs[0].resolve() == runs[1].resolve():
        raise typer.BadParameter(f"{runs[0]} and {runs[1]} are one run; name two")
    from probe.detection import compare as compare_recordings
    from probe.storage.run import open_run

    recordings = [open_run(run).recording() for run in runs]
    simulated = sorted({name for one in recordings for name in one.simulated})
    found = plain({**compare_recordings(*recordings).as_json(), "simulated": simulated})
    if json:
        answer_json(found)
        return
    ratios = ", ".join(
        f"{name} {found[key]:.3g}" if found[key] is not None else f"{name} unknown"
        for name, key in (("peak A/B", "peak_ratio"), ("pulse A/B", "pulse_ratio"))
    )
    if found["diseased"] != "undecided":
        ratios += f"; confidence {percent(found['confidence'])}"
    if simulated:
        answer(simulated_words(simulated))
    for letter, run in zip("AB", runs, strict=True):
        answer(f"{letter}: {run}")
    answer(f"diseased vessel: {found['diseased']} ({ratios})")
    answer(f"  {found['reason']}")


def twin(
    run: RunFile,
    out: Annotated[Path, typer.Option("--out", help="The scene file to write.")],
    priors: PriorsFile = None,
    json: Json = False,
) -> None:
    """Write the scene that one run's tissue most likely is, to press or scan in its place."""
    if out.exists():
        raise typer.BadParameter(f"{out} exists already: move it, or give another --out")
    from probe.calibrate.scene_from_measurement import write_scene
    from probe.cli.scenes import describe
    from probe.detection.twin import twin as twin_of

    scene = twin_of(run, priors=priors)
    write_scene(scene, out)
    if json:
        answer_json({"scene": str(out), **scene.model_dump(mode="json")})
        return
    answer(f"{out}: {describe(scene)}")
    answer(f"  scan it in place of the tissue: palpate scan --scene {out}")


def finding_json(
    run_path: Path,
    recording: Any,
    began_s: float,
    false_alarm: float = DEFAULT_FALSE_ALARM,
    asked_pa: float | None = None,
    priors: Any = None,
) -> dict[str, Any]:
    """The JSON object of ``scan`` and ``detect``."""
    from probe.detection import detect as detect_in

    finding = detect_in(recording, false_alarm=false_alarm, asked_pa=asked_pa, priors=priors)
    printed: dict[str, Any] = plain(
        {
            "run": run_path,
            **finding.as_json(),
            "finish": recording.finish,
            "simulated": recording.simulated,
            "seconds": time.perf_counter() - began_s,
        }
    )
    return printed


def show_finding(found: Mapping[str, Any]) -> None:
    """The stations as a compact table, then what lies beneath."""
    if 0 < len(found["stations"]) <= MAX_LINES:
        show_stations(found["stations"])
    elif found["stations"]:
        answer(f"{len(found['stations'])} stations: --json lists them")
    if found["simulated"]:
        answer(simulated_words(found["simulated"]))
    for line in summary(found):
        answer(line)


def show_stations(stations: Sequence[Mapping[str, Any]]) -> None:
    """A table with a line per station, counted from 1; y only where stations differ in it."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    axes = ("x", "y") if has_rows(one["y_mm"] for one in stations) else ("x",)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    heads = (f"{axis} mm" for axis in axes)
    for head in ("station", *heads, "baseline Pa", "± 95 %", "pulse Pa", "± 95 %"):
        table.add_column(head, justify="right")
    for one in stations:
        places = [number_words(one[f"{axis}_mm"], ".1f") for axis in axes]
        table.add_row(str(one["station"]), *places, *size_words(one))
    answer_table(Console(width=80), table)
