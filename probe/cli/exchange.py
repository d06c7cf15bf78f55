"""``palpate export`` and ``palpate import``: runs to and from other programs."""

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from probe.cli.arguments import RunFiles, export_formats
from probe.cli.say import Json, answer, answer_json, inform, next_command
from probe.cli.several import of_each

if TYPE_CHECKING:
    from probe.detection.finding import Finding


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
        files = export(run, formats, out or run.parent, _finding(run))
        for file in () if json else files:
            answer(str(file))
        return {"run": run, "files": files}

    written, status = of_each(runs, write)
    if json:
        answer_json(written[0] if len(written) == 1 else {"runs": written})
    raise typer.Exit(status)


def _finding(run: Path) -> "Finding | None":
    """What lies beneath; None of a run that detection cannot read, as one without a force."""
    from probe.core.errors import RunFileError
    from probe.detection import detect

    try:
        return detect(run)
    except RunFileError:
        return None


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
    maps: Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            metavar="NAME=COLUMN|FILE.toml",
            help="Which column is what: force_n='Fz [N]', '-Fz' turns the sign; or a TOML file "
            "of such lines, which may say rate_hz too.",
        ),
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option(min=1e-3, max=1e6, help="Samples a second, where the file has no times."),
    ] = None,
    json: Json = False,
) -> None:
    """Make a run of a recording from elsewhere, to detect in it, show and report it.

    Columns are named with their unit: time_s; one of force_n, pressure_pa, pressure_mbar; if known
    x_mm, y_mm, depth_mm (below the surface), station, reference. What `palpate export` wrote is
    read too, and MCAP files with geometry_msgs/WrenchStamped: the force along z is taken as the
    normal force, or what --map says, as force_n=-force.x. Of an export with several sensors
    the one that the run was judged on is taken.
    Recordings of other programs (.mat, .npy, .npz, .h5, .xdf, .bag, .db3, .lvm, .txt, .tsv, and CSV
    with any names) are read with --map.
    """
    from probe.storage.csv_import import import_csv

    mapping, said_hz = _mapping(maps or [])
    made = import_csv(
        file, out, face_mm2=face_mm2, topic=topic, mapping=mapping, rate_hz=rate_hz or said_hz
    )
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


def _mapping(said: list[str]) -> tuple[dict[str, str], float | None]:
    """Columns by what they are, and samples a second where a file of them says so."""
    mapping: dict[str, str] = {}
    rate_hz = None
    for item in said:
        name, equals, column = item.partition("=")
        if equals:
            mapping[name.strip()] = column
            continue
        try:
            kept = tomllib.loads(Path(item).read_text(encoding="utf-8"))
            rate_hz = float(kept.pop("rate_hz")) if "rate_hz" in kept else rate_hz
        except (OSError, ValueError, TypeError) as error:
            raise typer.BadParameter(
                f"--map {item}: NAME=COLUMN or a TOML file ({error})"
            ) from None
        mapping |= {key: str(value) for key, value in kept.items()}
    return mapping, rate_hz
