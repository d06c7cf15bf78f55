"""``palpate export`` and ``palpate import``: runs to and from other programs."""

from pathlib import Path
from typing import Annotated, Any

import typer

from probe.cli.arguments import RunFiles, export_formats
from probe.cli.say import Json, answer, answer_json, inform, next_command
from probe.cli.several import of_each


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command("export")(export_run)
    app.command("import")(import_run)


def export_run(
    runs: RunFiles,
    to: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="One or several of csv, hdf5, netcdf, parquet, mcap.",
            autocompletion=export_formats,
        ),
    ] = "csv",
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder to write to; default: the run's own.")
    ] = None,
    json: Json = False,
) -> None:
    """Write a run as CSV, HDF5, netCDF, Parquet or MCAP."""
    from probe.storage.export import WRITERS, export

    formats = [name.strip() for name in to.split(",")]
    if unknown := [name for name in formats if name not in WRITERS]:
        allowed = ", ".join(WRITERS)
        raise typer.BadParameter(f"--to {to}: {unknown[0]!r} is not known; allowed: {allowed}")

    def write(run: Path) -> dict[str, Any]:
        files = export(run, formats, out or run.parent)
        for file in () if json else files:
            answer(str(file))
        return {"run": run, "files": files}

    written, status = of_each(runs, write)
    if json:
        answer_json(written[0] if len(written) == 1 else {"runs": written})
    raise typer.Exit(status)


def import_run(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.csv|FILE.mcap|…", help="CSV may be gzipped.")
    ],
    out: Annotated[Path, typer.Option(metavar="RUN", help="The run file to make.")],
    face_mm2: Annotated[
        float | None, typer.Option(help="Area of the probe's face [mm2], for forces.")
    ] = None,
    topic: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which WrenchStamped topic of an MCAP file to take."),
    ] = None,
    json: Json = False,
) -> None:
    """Make a run of a recording from elsewhere, to detect in it, show and report it.

    Columns are named with their unit: time_s; one of force_n, pressure_pa, pressure_mbar; if known
    x_mm, y_mm, depth_mm (below the surface), station, reference. What `palpate export` wrote is
    read too, and MCAP files with geometry_msgs/WrenchStamped: the force along z is taken as the
    normal force. Of an export with several sensors the one that the run was judged on is taken.
    """
    from probe.storage.csv_import import import_csv

    made = import_csv(file, out, face_mm2=face_mm2, topic=topic)
    for note in made.notes:
        inform(f"note: {note}")
    if json:
        answer_json(
            {
                "run": made.path,
                "stations": made.stations,
                "samples": made.samples,
                "notes": made.notes,
            }
        )
    else:
        many = "station" if made.stations == 1 else "stations"
        answer(f"Run: {made.path} ({made.stations} {many}, {made.samples} samples)")
        answer(f"What it means: {next_command('detect', made.path)}")
