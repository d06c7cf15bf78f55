"""``palpate calibrate``: from raw readings to a calibration file that scans apply."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from probe.cli.arguments import calibration_kinds, storable
from probe.cli.guide import GUIDE
from probe.cli.say import Json, answer, answer_json, inform

UNITS: dict[str, dict[str, str]] = {
    "force": {"offset": "raw", "sensitivity": "raw/N", "temperature": "raw/K"},
    "taxels": {"offset": "raw", "sensitivity": "raw/Pa"},
    "gravity": {"mass": "kg", "centre": "m", "force bias": "N", "torque bias": "Nm"},
    "tare": {"bias": "raw", "drift": "raw/s"},
    "tool": {"tip": "m", "pivot": "m"},
    "axes": {"shift": "m"},
    "surface": {"height": "m", "bend": "1/m"},
    "latency": {"delay": "s"},
    "compliance": {"stiffness": "N/m", "contact": "m", "zero": "N"},
    "tissue": {"log modulus": "ln Pa", "surface": "mm", "log tau": "ln s"},
    "heart": {"rate": "1/min"},
}
"""What is printed behind a value, by the beginning of its name; nothing for pure numbers."""


def calibrate(
    kind: Annotated[str, typer.Argument(help=", ".join(GUIDE), autocompletion=calibration_kinds)],
    readings: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE.csv|FILE.run]",
            help="Raw readings. Without it: how to take them, step by step.",
        ),
    ] = None,
    device: Annotated[
        str,
        typer.Option(
            help="The device's name in the rig file; without one there, what `palpate doctor RIG` "
            "calls it (force). A run names it itself.",
            callback=storable,
        ),
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json", help="The calibration file to write; default: KIND-DEVICE.json."
        ),
    ] = None,
    model: Annotated[
        str, typer.Option(help="surface: its shape, plane, quadric or map.")
    ] = "plane",
    scene: Annotated[
        str,
        typer.Option(metavar="NAME|FILE", help="tissue: the scene with the block and the finger."),
    ] = "TI",
    relaxation_s: Annotated[
        list[float] | None,
        typer.Option(help="tissue: a first guess of a relaxation time [s], once per term."),
    ] = None,
    cuff: Annotated[
        str, typer.Option(metavar="SYS/DIA", help="heart: the cuff's reading [mmHg].")
    ] = "120/80",
    station: Annotated[
        int | None, typer.Option(min=1, help="Which press of a run to use, from 1.")
    ] = None,
    scene_out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml", help="tissue, heart: write what was found as a scene file."
        ),
    ] = None,
    live: Annotated[
        Path | None,
        typer.Option(
            metavar="RIG.toml", help="force: take the readings from the sensor, load by load."
        ),
    ] = None,
    readings_out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="With --live: where the readings go; default: loads-DEVICE.csv.",
        ),
    ] = None,
    note: Annotated[
        str, typer.Option(help="A remark that is kept in the file.", callback=storable)
    ] = "",
    json: Json = False,
) -> None:
    """Fit one calibration to raw readings, print its intervals, and write its file.

    The rig file then names it: [calibration] force = "force-NAME.json". Without readings, says
    how to take them.
    """
    if kind not in GUIDE:
        raise typer.BadParameter(f"kind {kind!r}: allowed are {', '.join(GUIDE)}")
    if scene_out is not None:
        from probe.calibrate.scene_from_measurement import check_scene_out

        check_scene_out(scene_out, kind)
    if live is not None:
        if kind != "force" or readings is not None:
            raise typer.BadParameter("--live takes the readings of kind force, without a table")
        readings, device = _take_live(live, device, readings_out)
    if readings is None:
        if json:
            answer_json({"kind": kind, "guide": GUIDE[kind]})
        else:
            answer(GUIDE[kind])
        return
    from calibration import record, save
    from calibration.errors import CalibrationError
    from probe.calibrate.doubts import doubts
    from probe.calibrate.fits import (
        Choices,
        check_drift,
        fit_measurements,
        low_pass_found,
        raw_columns,
    )
    from probe.calibrate.measurements import read
    from probe.calibrate.scene_from_measurement import scene_found, write_found
    from sim_backend.scene.scene_file import load_scene

    cuff_mmhg = _cuff(cuff)
    r = read(readings, kind, device, station)
    if not r.device:
        raise CalibrationError(
            f"{readings}: a table does not say whose it is; add --device NAME, the name in the "
            "rig file or, without one there, what `palpate doctor RIG` calls it (force)"
        )
    for note in r.notes:
        inform(note)
    block = load_scene(scene)
    choices = Choices(model, block, tuple(relaxation_s or ()), cuff_mmhg)
    path = out or Path(f"{kind}-{r.device.replace(' ', '-').replace('/', '-')}.json")
    if scene_out is not None and scene_out.absolute() == path.absolute():
        raise typer.BadParameter(f"--scene-out {scene_out}: so is --out; name two files")
    if (drift := check_drift(path, kind, r)) is not None:
        inform(f"the calibration in {path} so far: {drift}")
    if kind == "latency" and (slow := low_pass_found(r)) is not None:
        inform(f"note: {slow}")
    result = fit_measurements(kind, r, choices)
    # made before anything is written: where it cannot be, nothing is left half done
    made = None if scene_out is None else scene_found(block, result, scene_out)
    one = record(result, r.device, raw_columns(r), note=note)
    save(one, path)
    if json:
        answer_json(_as_json(path, one))
    else:
        _show(result, path, one)
    for doubt in doubts(result):
        inform(f"warning: {doubt}")
    if made is not None and scene_out is not None:
        write_found(made, result, scene_out)
        inform(f"scene: {scene_out}")


def _take_live(rig: Path, device: str, table: Path | None) -> tuple[Path, str]:
    """Ask for load after load; the table and the sensor's name."""
    from drivers import WallClock
    from probe.calibrate.weigh import take_weights
    from probe.config.devices import open_sensors
    from probe.scan.session import resolve_rig

    whole, scene = resolve_rig(rig, None)
    clock = WallClock()
    with open_sensors(whole, clock, scene) as sensors:
        known = {sensor.name: sensor for sensor in sensors}
        if not device and len(known) == 1:
            (device,) = known
        if device not in known:
            raise typer.BadParameter(f"--device {device!r}: {rig} has {', '.join(known)}")
        path = table or Path(f"loads-{device.replace(' ', '-')}.csv")
        take_weights(known[device], clock, path, _ask, inform)
    if not path.exists():
        raise typer.BadParameter("no load was taken: there is nothing to fit")
    inform(f"readings: {path}")
    return path, device


def _ask(question: str) -> str:
    """A line from the person; the end of the input ends the loads too."""
    inform(question)
    return sys.stdin.readline()


def _cuff(text: str) -> tuple[float, float]:
    try:
        systolic, diastolic = (float(part) for part in text.split("/"))
    except ValueError:
        raise typer.BadParameter(f"--cuff {text!r}: say it as 120/80 (mmHg)") from None
    return systolic, diastolic


def _as_json(path: Path, one: Any) -> dict[str, Any]:
    return {
        "file": path,
        "kind": one.kind,
        "device": one.device,
        "values": {name: q.model_dump() for name, q in one.values.items()},
        "residual_rms": one.residual_rms,
        "valid_days": one.valid_days,
    }


def _show(result: Any, path: Path, one: Any) -> None:
    fit = result.fit
    for name, value, (low, high) in zip(fit.names, fit.values, fit.interval(), strict=True):
        unit = next((u for start, u in UNITS[one.kind].items() if name.startswith(start)), "")
        answer(f"{name:24} {value:12.6g} {unit:6} 95 %: {low:.6g} to {high:.6g}")
    if one.kind == "tissue":
        for kpa, (low, high) in zip(
            1e-3 * result.modulus_pa, 1e-3 * result.modulus_interval_pa(), strict=True
        ):
            answer(f"{'modulus':24} {kpa:12.5g} kPa    95 %: {low:.5g} to {high:.5g}")
        for limit in result.cannot_identify:
            answer(f"not known from this: {limit}")
    if one.kind == "surface" and len(result.rejected_m):
        answer(f"{len(result.rejected_m)} of {len(one.raw['x_mm'])} touches left out as outliers")
    if one.kind == "tare":
        known_to = result.known_to()
        answer(
            f"good for {result.good_for_s(known_to):.3g} s: then drift alone may exceed "
            f"{known_to:.3g}, to which the bias itself is known (95 %)"
        )
    if one.kind == "taxels":
        answer(f"{int(result.dead.sum())} dead of {len(result.dead)}")
    if one.kind == "force":
        answer(
            f"off a straight line by {100 * result.linearity:.2g} % of the span, rising loads off "
            f"falling ones by {100 * result.hysteresis:.2g} %"
        )
    if one.kind == "compliance":
        way_mm = 1e3 * result.force_max_n / result.stiffness_n_m
        answer(f"gives way by {way_mm:.3g} mm at the largest force, {result.force_max_n:.3g} N")
    days = f"{one.valid_days:g} day{'s' * (one.valid_days != 1)}"
    answer(f"residuals {one.residual_rms:.3g} rms, valid for {days}: {path}")
