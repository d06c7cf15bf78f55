"""``palpate calibrate``: from a table of raw readings to a calibration file that scans apply."""

from pathlib import Path
from typing import Annotated, Any

import typer

from probe.cli.say import Json, answer, answer_json, plain, tell

COLUMNS: dict[str, str] = {
    "force": "raw or raw_0, raw_1 …; load_n or load_0_n …; optional temperature_c",
    "taxels": "raw_0, raw_1 …; pressure_pa",
    "gravity": "fx_n, fy_n, fz_n, mx_nm, my_nm, mz_nm; rx_rad, ry_rad, rz_rad (sensor in base)",
    "tare": "time_s; value or value_0, value_1 …",
    "tool": "x_mm, y_mm, z_mm; rx_rad, ry_rad, rz_rad (flange in base, tip on one point)",
    "axes": "x_mm, y_mm, z_mm (read); true_x_mm, true_y_mm, true_z_mm",
    "surface": "x_mm, y_mm, z_mm of the tip at each touch",
    "latency": "time_s, depth_mm of the stage; sensor_time_s, force_n",
    "compliance": "depth_mm, force_n on a rigid block",
    "tissue": "depth_mm, force_n on plain tissue; optional time_s",
    "heart": "time_s, reference (PPG, ECG or pressure)",
}


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command()(calibrate)


def calibrate(
    kind: Annotated[str, typer.Argument(help="; ".join(f"{k}: {v}" for k, v in COLUMNS.items()))],
    table: Annotated[Path, typer.Argument(metavar="FILE.csv", help="Raw readings, one per row.")],
    device: Annotated[str, typer.Option(help="The device's name, as in the rig file.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Default: KIND-DEVICE.json.")
    ] = None,
    model: Annotated[str, typer.Option(help="Of a surface: plane, quadric or map.")] = "plane",
    scene: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="Of tissue: block and finger.")
    ] = "TI",
    twin: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Of tissue: write the scene found.")
    ] = None,
    note: Annotated[str, typer.Option(help="Kept in the file.")] = "",
    json: Json = False,
) -> None:
    """Fit one calibration to raw readings, show how well it holds, and write its file.

    The rig file then names it: [calibration] force = "force-NAME.json".
    """
    from calibration import record, save
    from probe.calibrate import fit_table

    if kind not in COLUMNS:
        raise typer.BadParameter(f"kind {kind!r}: allowed are {', '.join(COLUMNS)}")
    result, raw = fit_table(kind, table, surface_model=model, scene_name=scene, twin=twin)
    path = out or Path(f"{kind}-{device}.json")
    one = record(result, device, raw, note=note)
    save(one, path)
    told: dict[str, Any] = {
        "file": path,
        "kind": kind,
        "device": device,
        "values": {name: q.model_dump() for name, q in one.values.items()},
        "residual_rms": one.residual_rms,
        "valid_days": one.valid_days,
    }
    if json:
        answer_json(plain(told))
        return
    fit = result.fit
    for name, value, (low, high) in zip(fit.names, fit.values, fit.interval(), strict=True):
        answer(f"{name:24} {value:12.6g}   95 %: {low:.6g} to {high:.6g}")
    answer(f"residuals {one.residual_rms:.3g} rms, good for {one.valid_days:g} days: {path}")
    if twin is not None:
        tell(f"scene: {twin}")
