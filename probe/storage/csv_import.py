"""``palpate import FILE --out RUN``: a recording made elsewhere becomes a run file.

Columns carry their unit: ``time_s``, one of ``force_n``, ``pressure_pa``, ``pressure_mbar``,
``taxels_n``, ``taxels_pa`` or ``taxels_counts``, and if known ``x_mm``, ``y_mm``, ``depth_mm`` (of
the tip below the surface), ``station`` and ``reference`` (a PPG or ECG beside it).

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

from drivers import Block
from drivers.core.units import to_si
from probe.config.load_rig import load_rig
from probe.config.rig import Rig
from probe.config.snapshot import face_mm2_of, library_versions
from probe.core.cut_stations import OF_BLOCK
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
from probe.storage.csv_table import CsvRecording, cut
from probe.storage.import_columns import Asked
from probe.storage.import_doubts import doubts
from probe.storage.import_readers import read_recording
from probe.storage.import_table import ARRAYS, DEVICE, PHASE, CsvError, check_face
from probe.storage.writer import create_store
from sim_backend.scene.scene_file import Scene, as_scene

__all__ = ["CsvError", "Imported", "import_csv"]

BLOCK = 1000  # samples
FACE_MM2 = 100.0
UNKNOWN_FORCE = (
    "the readings are counts, and how much force or stress they are is not known: no level, pulse "
    "or kind is stated; `palpate detect RUN --empty EMPTY` says which presses are unlike presses "
    "over nothing"
)


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
    mapping: Mapping[str, str | list[str]] | None = None,
    rate_hz: float | None = None,
    layout: tuple[int, int] | None = None,
    tare_s: float | None = None,
    scene: Scene | str | Path | None = None,
    rig: Rig | str | Path | None = None,
) -> Imported:
    """Read a recording made elsewhere and write it as a new run file.

    Parameters
    ----------
    source
        What ``palpate export`` wrote, or a file of any format of
        `probe.storage.import_readers`.
    out
        The new run file.
    face_mm2
        The probe's face [mm2], which turns a force into the stress that detection works on;
        it scales what is found and does not change what is found. By default the file's
        own, as ``palpate export`` writes it to netCDF, HDF5, Parquet and MCAP, then that of
        ``rig`` or ``scene``.
    topic
        What the columns to take begin with: a topic of a bag, a stream of an XDF file.
    mapping
        The file's own name of each column, as ``{"force_n": "Fz [mN]"}``; ``"-Fz"`` turns the
        sign, and several ``time_s`` belong to streams of their own. Without it the columns are
        named as ours.
    rate_hz
        Samples a second, where the file has no times.
    layout
        Rows and columns of an array of taxels.
    tare_s
        The mean of the first ``tare_s`` seconds of each press is taken as its zero.
    scene
        The block and the finger, as a built-in scene or a scene file says them; what lies in
        it is not taken.
    rig
        A rig file, whose face and scene are taken.

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
    known = load_rig(rig) if isinstance(rig, str | Path) else rig
    if scene is None and known is not None and known.scene is not None:
        scene = known.scene.name
    block = None if scene is None else as_scene(scene)
    asked = Asked(mapping or {}, rate_hz, topic, layout)
    try:
        table = read_recording(source, asked)
        check_face(table.face_mm2, "the face_mm2 of its run")
        read = cut(table, tare_s)
    except CsvError as error:
        text = str(error)
        raise CsvError(text if text.startswith(str(source)) else f"{source}: {text}") from None
    face_mm2 = face_mm2 or table.face_mm2 or face_mm2_of(known or Rig(), block)
    notes = read.notes
    unit = read.devices[DEVICE][0].unit
    if unit == ARRAYS["taxels_counts"]:
        notes = (*notes, UNKNOWN_FORCE)
    if face_mm2 is None and to_si(unit)[0] == "N":
        notes = (*notes, f"the probe's face is not known; {FACE_MM2:g} mm2 is assumed")
    notes = (*notes, *doubts(read))
    config = _config(read, source, asked, tare_s) | {"face_mm2": face_mm2 or FACE_MM2}
    if block is not None:
        config["block"] = block.model_dump(mode="json", include=set(OF_BLOCK))
    broken_off = _broken_off(read) if PHASE in read.table.rows else set()
    if broken_off:
        which = ", ".join(str(station + 1) for station in sorted(broken_off))
        notes = (*notes, f"presses that broke off are kept, and not judged: station {which}")
    with create_store(out) as store:
        for event in _events(read, config, notes, broken_off):
            store(event)
    samples = sum(len(press.signal.time_s) for press in read.presses)
    return Imported(out, len(read.presses), samples, notes)


def _broken_off(read: CsvRecording) -> set[int]:
    """Stations whose press was stopped, or never lifted where others were."""
    phases = {p.station: {tuple(Phase)[number] for _, number in p.phases} for p in read.presses}
    lifted = {station for station, own in phases.items() if Phase.RETRACTING in own}
    stopped = {station for station, own in phases.items() if Phase.STOPPING in own}
    return stopped | (set(phases) - lifted if lifted else set())


def _config(read: CsvRecording, source: Path, asked: Asked, tare_s: float | None) -> dict[str, Any]:
    return {
        "imported": {
            "file": os.fsencode(source).decode("utf-8", "replace"),  # a name may be no text
            "sha256": read.table.sha256,
            "rows": len(read.table.rows),
            "asked": asked._asdict() | {"tare_s": tare_s},
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
    devices = dict(read.devices)
    began_s, ended_s = read.presses[0].start_s, read.presses[-1].end_s
    yield RunStarted(began_s, datetime.now(UTC).isoformat(timespec="seconds"), config, devices)
    for note in notes:
        yield Note(began_s, "warning", "import", note)
    for press in read.presses:
        yield StationStarted(press.start_s, press.station, 1, press.x_m, press.y_m)
        for entered_s, number in press.phases:
            yield PhaseEntered(entered_s, tuple(Phase)[number], press.station)
        for device, stream in press.streams.items():
            for first in range(0, len(stream.time_s), BLOCK):
                part = slice(first, first + BLOCK)
                block = Block(stream.time_s[part], stream.values[part], stream.saturated[part])
                yield Samples(device, block, press.station, 1)
        complete = press.station not in broken_off
        yield StationEnded(press.end_s, press.station, 1, complete=complete)
    finish = Finish.ABORTED if broken_off else Finish.COMPLETED
    yield RunEnded(ended_s, finish, "imported")


def _mm(length_m: float) -> float | None:
    return None if np.isnan(length_m) else 1e3 * length_m
