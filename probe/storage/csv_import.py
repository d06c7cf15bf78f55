"""``palpate import FILE.csv --out RUN``: a recording made elsewhere becomes a run file.

Columns carry their unit: ``time_s``, one of ``force_n``, ``pressure_pa`` or ``pressure_mbar``, and
if known ``x_mm``, ``y_mm``, ``depth_mm`` (of the tip below the surface), ``station`` and
``reference`` (a PPG or ECG beside it).

- Rows without a reading (empty or NaN) are left out and counted; times may be uneven.
- Without ``station``, a change of position begins a new one; without positions all is one. A
  recording that has the ways between stations, too, is refused.
- Stations that do not follow in time (each begins at 0) are put one after the other, 1 s apart.
- What no column says is not invented. Phases and what is simulated come from what
  ``palpate export`` wrote: else the way down would be taken for a part of the hold.
"""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from drivers import Block, Channel
from drivers.core.arrays import Array, Bools
from drivers.core.units import to_si
from probe.config.snapshot import library_versions
from probe.core.contact_stress import PRESSED_N
from probe.core.events import (
    Event,
    Finish,
    Note,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.core.places import SAME_PLACE_M
from probe.storage.csv_columns import first_line
from probe.storage.csv_table import CsvRecording, cut, read_csv
from probe.storage.import_foreign import read_foreign
from probe.storage.import_formats import ENDINGS, is_exported, read_format
from probe.storage.import_table import CsvError, check_face
from probe.storage.writer import create_store

__all__ = ["CsvError", "Imported", "import_csv"]

DEVICE, REFERENCE, DEPTHS = "imported", "reference", "depth"
BLOCK = 1000  # samples
FACE_MM2 = 100.0
MANY = 3  # places: of a row or a grid; two are as soon one place that was moved by a little


@dataclass(frozen=True)
class Imported:
    """What was written; ``notes`` say what was left out or assumed.

    Examples
    --------
    >>> import palpate
    >>> imported = palpate.import_csv("press.csv", "imported.run", face_mm2=100.0)
    >>> imported.stations, imported.samples
    (1, 500)
    """

    path: Path
    stations: int
    samples: int
    notes: tuple[str, ...]


def import_csv(
    source: str | Path,
    out: str | Path,
    *,
    face_mm2: float | None = None,
    topic: str | None = None,
    mapping: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
) -> Imported:
    """Read a recording made elsewhere and write it as a new run file.

    Parameters
    ----------
    source
        A CSV (or .csv.gz), what ``palpate export`` wrote, or an MCAP file: see
        `probe.storage.import_formats`.
    out
        The new run file.
    face_mm2
        The probe's face [mm2], which turns a force into the stress that detection works on;
        it scales what is found and does not change what is found. By default the file's
        own, as ``palpate export`` writes it to netCDF, HDF5, Parquet and MCAP.
    topic
        Of an MCAP file: the topic of its wrenches.
    mapping
        The file's own name of each column, as ``{"force_n": "Fz [N]"}``; ``"-Fz [N]"`` turns the
        sign. With it, or of a format of `probe.storage.import_foreign`, any names are read.
    rate_hz
        Samples a second, where the file has no times.

    Returns
    -------
    Imported
        The new file, and what was read.

    Raises
    ------
    CsvError
        Says what is wrong with the recording, and where.
    StoreError
        ``out`` exists or cannot be written.

    Examples
    --------
    A table of ``time_s`` and ``force_n`` becomes a run that all else reads:

    >>> import palpate
    >>> imported = palpate.import_csv("press.csv", "press.run", face_mm2=100.0)
    >>> palpate.open_run(imported.path).recording().channels
    ('imported.force',)
    """
    source, out = Path(source), Path(out)
    check_face(face_mm2, f"{source}: face_mm2")
    try:
        named = not is_exported(first_line(source)) and source.suffix not in ENDINGS
        known = (*ENDINGS, ".csv", ".gz")
        others = bool(mapping) and source.suffix != ".mcap"
        if others or rate_hz is not None or source.suffix.lower() not in known:
            table = read_foreign(source, mapping, rate_hz)
        elif not named:
            table = read_format(source, topic, mapping)
        else:
            table = read_csv(source)
        check_face(table.face_mm2, "the face_mm2 of its run")
        read = cut(table)
    except CsvError as error:
        text = str(error)
        raise CsvError(text if text.startswith(str(source)) else f"{source}: {text}") from None
    face_mm2 = table.face_mm2 if face_mm2 is None else face_mm2
    notes = read.notes
    if face_mm2 is None and to_si(read.channels[0].unit)[0] == "N":
        notes = (*notes, f"the probe's face is not known; {FACE_MM2:g} mm2 is assumed")
    if _mostly_negative(read):
        what = read.channels[0].role
        notes = (*notes, f"{what} is negative where it is largest: here pressed is positive")
    if _never_below(read):
        notes = (*notes, "depth_mm is never above 0: here it is positive below the surface")
    notes = (*notes, *_in_another_unit(read, named))
    config = _config(read, source) | {"face_mm2": face_mm2 or FACE_MM2}
    broken_off = _broken_off(read)
    if broken_off:
        which = ", ".join(str(station + 1) for station in sorted(broken_off))
        notes = (*notes, f"presses that broke off are kept, and not judged: station {which}")
    with create_store(out) as store:
        for event in _events(read, config, notes, broken_off):
            store(event)
    samples = sum(len(press.time_s) for press in read.presses)
    return Imported(out, len(read.presses), samples, notes)


def _mostly_negative(read: CsvRecording) -> bool:
    """Whether most presses read less than nothing where they read most."""
    means = [np.nanmean(press.signal, axis=1) for press in read.presses]
    down = [bool(mean[np.abs(mean).argmax()] < 0) for mean in means]
    return sum(down) > len(down) / 2


def _in_another_unit(read: CsvRecording, named: bool) -> Iterator[str]:
    """What is possible, but hardly in the unit that its column names, each in a sentence; only of
    a file that is ``named`` so has the force a column of that name."""
    for n, channel in enumerate(read.channels):
        base, factor = to_si(channel.unit)
        force_n = factor * np.concatenate([press.signal[:, n] for press in read.presses])
        if base == "N" and np.nanmax(np.abs(force_n), initial=0.0) > PRESSED_N:
            what = "force_n" if named else channel.role
            yield (
                f"{what} spans {np.nanmin(force_n):.3g} to {np.nanmax(force_n):.3g} N, where no "
                f"press of soft tissue has more than {PRESSED_N:g}: is it in mN?"
            )
    places_m = np.nan_to_num([(press.x_m, press.y_m) for press in read.presses])
    span_m = float(np.hypot(*np.ptp(places_m, axis=0)))
    places = len(np.unique(places_m, axis=0))
    if places >= MANY and span_m <= 2 * SAME_PLACE_M:
        yield (
            f"x_mm, y_mm: {places} places span {1e3 * span_m:.2g} mm in all, and all that lies "
            f"within {2e3 * SAME_PLACE_M:g} counts as one place: are they in metres?"
        )


def _never_below(read: CsvRecording) -> bool:
    """Whether depths are known, and none is below the surface."""
    known = np.concatenate([press.depth_m for press in read.presses])
    known = known[np.isfinite(known)]
    return bool(len(known)) and float(known.max()) <= 0


def _broken_off(read: CsvRecording) -> set[int]:
    """Stations whose press was stopped, or never lifted where others were."""
    phases = {p.station: {tuple(Phase)[number] for _, number in p.phases} for p in read.presses}
    lifted = {station for station, own in phases.items() if Phase.RETRACTING in own}
    stopped = {station for station, own in phases.items() if Phase.STOPPING in own}
    return stopped | (set(phases) - lifted if lifted else set())


def _config(read: CsvRecording, source: Path) -> dict[str, Any]:
    return {
        "imported": {
            "file": os.fsencode(source).decode("utf-8", "replace"),  # a name may be no text
            "sha256": read.sha256,
            "rows": read.rows,
            "columns": list(read.columns),
        },
        "rig": None,
        "scene": None,
        "plan": {
            "stations": [[p.station, _mm(p.x_m), _mm(p.y_m)] for p in read.presses],
            "columns": ["index", "x_mm", "y_mm"],
        },
        "calibration": {},
        "versions": library_versions(),
        "seed": None,
    }


def _events(
    read: CsvRecording, config: dict[str, Any], notes: tuple[str, ...], broken_off: set[int]
) -> Iterator[Event]:
    channels = {DEVICE: read.channels}
    if read.has_reference:
        channels[REFERENCE] = (Channel("reference", "", "reference"),)
    if any(np.isfinite(press.depth_m).any() for press in read.presses):
        channels[DEPTHS] = (Channel("depth", "m", "depth"),)
    began_s, ended_s = read.presses[0].start_s, read.presses[-1].end_s
    yield RunStarted(began_s, datetime.now(UTC).isoformat(timespec="seconds"), config, channels)
    for note in notes:
        yield Note(began_s, "warning", "import", note)
    for press in read.presses:
        yield StationStarted(press.start_s, press.station, 1, press.x_m, press.y_m)
        for entered_s, number in press.phases:
            yield PhaseEntered(entered_s, tuple(Phase)[number], press.station)
        yield from _blocks(DEVICE, press.station, press.time_s, press.signal, press.saturated)
        yield from _beside(REFERENCE, press.station, press.reference_s, press.reference)
        known = np.isfinite(press.depth_m)
        yield from _beside(DEPTHS, press.station, press.time_s[known], press.depth_m[known])
        complete = press.station not in broken_off
        yield StationEnded(press.end_s, press.station, 1, complete=complete)
    finish = Finish.ABORTED if broken_off else Finish.COMPLETED
    yield RunEnded(ended_s, finish, "imported")


def _beside(device: str, station: int, time_s: Array, values: Array) -> Iterator[Samples]:
    """Of one channel, which does not clip."""
    return _blocks(device, station, time_s, values[:, None], np.zeros((len(values), 1), bool))


def _blocks(
    device: str, station: int, time_s: Array, values: Array, saturated: Bools
) -> Iterator[Samples]:
    for first in range(0, len(time_s), BLOCK):
        part = slice(first, first + BLOCK)
        yield Samples(device, Block(time_s[part], values[part], saturated[part]), station, 1)


def _mm(length_m: float) -> float | None:
    return None if np.isnan(length_m) else 1e3 * length_m
