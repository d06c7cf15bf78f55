"""``palpate export`` and ``palpate import``: runs to and from other programs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from probe.cli.arguments import RunFiles, export_formats, rows_columns, scene_names
from probe.cli.say import Json, answer, inform, next_command
from probe.cli.several import of_each

if TYPE_CHECKING:
    from probe.detection.finding import Finding

MAX_MAP_BYTES = 1 << 16  # of a file with a mapping


def export(
    runs: RunFiles,
    to: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="One or several of csv, hdf5, netcdf, parquet, mcap, mat, lerobot.",
            autocompletion=export_formats,
        ),
    ] = "csv",
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder to write to; default: the run's own.")
    ] = None,
    json: Json = False,
) -> None:
    """Write a run as CSV, HDF5, netCDF, Parquet, MCAP, MATLAB or a dataset of lerobot."""
    from probe.storage.export import WRITERS
    from probe.storage.export import export as write_export

    formats = [name.strip() for name in to.split(",")]
    if unknown := [name for name in formats if name not in WRITERS]:
        allowed = ", ".join(WRITERS)
        raise typer.BadParameter(f"--to {to}: {unknown[0]!r} is not known; allowed: {allowed}")

    def write(run: Path) -> dict[str, Any]:
        files = write_export(run, formats, out or run.parent, _finding(run))
        for file in () if json else files:
            answer(str(file))
        return {"run": run, "files": files}

    _, status = of_each(runs, write, json=json)
    raise typer.Exit(status)


def _finding(run: Path) -> "Finding | None":
    """What lies beneath; None of a run that detection cannot read, as one without a force."""
    from probe.core.errors import RunFileError
    from probe.detection import detect

    try:
        return detect(run)
    except RunFileError:
        return None


def import_(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Any format; a text may be gzipped.")
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="RUN|DIR", help="The run to make; of several, the folder."),
    ],
    face_mm2: Annotated[
        float | None, typer.Option(help="Area of the probe's face [mm2], for forces.")
    ] = None,
    maps: Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            metavar="NAME=COLUMN|FILE.toml",
            help="Which column is what, in which unit: force_n='Fz [mN]'; '-Fz' turns the sign; or "
            "a TOML file of such lines and of these options.",
        ),
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option(min=1e-3, max=1e6, help="Samples a second, where the file has no times."),
    ] = None,
    layout: Annotated[
        str | None, typer.Option(metavar="4x7", help="Rows and columns of an array of taxels.")
    ] = None,
    tare_s: Annotated[
        float | None,
        typer.Option(help="Take the mean of the first seconds of each press as its zero."),
    ] = None,
    topic: Annotated[
        str | None, typer.Option(metavar="NAME", help="Take only columns that begin so.")
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE", help="The block and the finger.", autocompletion=scene_names
        ),
    ] = None,
    rig: Annotated[
        str | None, typer.Option(metavar="RIG.toml", help="The rig: its face and block.")
    ] = None,
    json: Json = False,
) -> None:
    """Make a run of a recording from elsewhere, to detect in it, show and report it.

    Columns are named with their unit: time_s; one of force_n, pressure_pa, pressure_mbar, taxels_n,
    taxels_pa, taxels_counts; if known x_mm, y_mm, depth_mm (below the surface), station, reference.
    Of what `palpate export` wrote, the channels are taken that the run was judged on.
    Recordings of other programs (text of instruments, .mat, .npy, .npz, .h5, .parquet, .xdf, .bag,
    .db3, .mcap) are read with --map; without it their columns are listed.
    """
    from probe.storage.csv_import import import_csv

    given = {
        "face_mm2": face_mm2, "rate_hz": rate_hz, "layout": layout, "tare_s": tare_s,
        "topic": topic, "scene": scene, "rig": rig,
    }  # fmt: skip
    settings = _settings(maps or []) | {name: v for name, v in given.items() if v is not None}
    if isinstance(said := settings.get("layout"), str):
        settings["layout"] = rows_columns(said, "--layout")
    sources = [one for file in files for one in _globbed(file)]
    several = len(sources) > 1 or out.is_dir()
    if several and out.suffix == ".run":
        raise typer.BadParameter(f"--out {out}: of {len(sources)} files the runs go to a folder")

    def read(source: Path) -> dict[str, Any]:
        name = f"{Path(source.name.removesuffix('.gz')).stem}.run"
        made = import_csv(source, out / name if several else out, **settings)
        for note in made.notes:
            inform(f"note: {f'{source}: ' if several else ''}{note}")
        many = "station" if made.stations == 1 else "stations"
        if not json:
            answer(f"Run: {made.path} ({made.stations} {many}, {made.samples} samples)")
        return {
            "run": made.path,
            "stations": made.stations,
            "samples": made.samples,
            "notes": made.notes,
        }

    if several:
        out.mkdir(parents=True, exist_ok=True)
    _, status = of_each(sources, read, json=json, together="runs" if several else "")
    if not (json or status):
        runs = f"palpate detect {out}/*.run" if several else next_command("detect", out)
        answer(f"What it means: {runs}")
    raise typer.Exit(status)


def _globbed(file: Path) -> list[Path]:
    """The files of a pattern that no shell has replaced, or the file itself."""
    if file.exists() or "*" not in str(file):
        return [file]
    base = next(parent for parent in file.parents if "*" not in str(parent))
    return sorted(base.glob(str(file.relative_to(base)))) or [file]


OPTIONS = {
    "face_mm2": float, "rate_hz": float, "layout": str, "tare_s": float, "topic": str,
    "scene": str, "rig": str,
}  # fmt: skip
"""What a file of ``--map`` may say beside its columns."""


def _settings(said: list[str]) -> dict[str, Any]:
    """Columns by what they are, and what else a file of them says."""
    mapping: dict[str, Any] = {}
    settings: dict[str, Any] = {}
    for item in said:
        name, equals, column = item.partition("=")
        name = name.strip()
        if equals and name == "time_s" and name in mapping:  # of streams of their own
            mapping[name] = [*mapping[name], column]
        elif equals:
            mapping[name] = [column] if name == "time_s" else column
        else:
            kept = _kept(item)
            settings |= {key: kept.pop(key) for key in OPTIONS if key in kept}
            for key in settings.keys() & {"rig", "scene"}:
                if (beside := Path(item).parent / settings[key]).is_file():
                    settings[key] = str(beside)
            mapping |= kept
    return settings | {"mapping": mapping}


def _kept(file: str) -> dict[str, Any]:
    from drivers.core.files import parse_toml, read_file

    try:
        kept = parse_toml(read_file(Path(file), MAX_MAP_BYTES))
    except (OSError, ValueError) as error:
        raise typer.BadParameter(f"--map {file}: NAME=COLUMN or a TOML file ({error})") from None
    for key, value in kept.items():
        texts = value if isinstance(value, list) and key == "time_s" else [value]
        wanted = OPTIONS.get(key, str)
        right = (int, float) if wanted is float else str
        if not all(isinstance(text, right) and not isinstance(text, bool) for text in texts):
            raise typer.BadParameter(
                f"--map {file}: {key} = {value!r}: {'a number' if wanted is float else 'text'} "
                "is wanted"
            )
    return kept
