"""A recording made elsewhere, cut into stations: a CSV whose columns carry their unit, or a table.

See `probe.storage.csv_import` for what is allowed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drivers import Channel
from drivers.core.arrays import Array, Bools, Ints
from drivers.core.extras import needs
from probe.core.events import Phase
from probe.core.places import SAME_PLACE_M
from probe.storage.csv_columns import read_columns
from probe.storage.import_table import (
    DEPTH,
    DEVICE,
    PHASE,
    REFERENCE,
    SIGNALS,
    TAXELS,
    CsvError,
    Table,
    saturated,
    signal,
)

with needs("data", "palpate import"):
    import pandas as pd

BETWEEN = -1  # the station of a row between two, as `palpate export` writes it
MAX_STATION = 1_000_000
GAP_S = 1.0
MIN_READINGS = 4  # of a station
MIN_PLACES, MIN_ROWS_EACH = 3, 10  # of a row that may be in metres
MIN_VALUES = 10  # different ones, of readings that no other press repeats by chance
DEPTH_SHARE, SIGMAS, ROUNDING_MM = 0.01, 3.0, 1e-9
"""A hold is looked for this near to the deepest, in whose middle half the tip is still; it is where
the tip is as deep as that, but for 3 standard deviations: one reading of 700 is less deep."""
MAX_DRIFT_MM = 1.0  # a quarter of the paper's pitch: places further apart are no one station


class Stream(NamedTuple):
    """Samples of one device: ``time_s`` (n,), ``values`` (n, channels), where ``saturated``."""

    time_s: Array
    values: Array
    saturated: Bools


@dataclass(frozen=True)
class Press:
    """One station's samples, by device; the first is the one that feels.

    All times lie in [``start_s``, ``end_s``). ``phases``: when which was entered, where that is
    known.
    """

    station: int
    x_m: float
    y_m: float
    streams: Mapping[str, Stream]
    start_s: float
    end_s: float
    phases: tuple[tuple[float, int], ...] = ()

    @property
    def signal(self) -> Stream:
        """Of the device that feels."""
        return self.streams[DEVICE]


@dataclass(frozen=True)
class CsvRecording:
    """A whole recording of ``table``: its presses, the ``devices`` of their streams, and ``notes``
    of what was left out."""

    presses: tuple[Press, ...]
    devices: Mapping[str, tuple[Channel, ...]]
    table: Table
    notes: tuple[str, ...]


def read_csv(source: Path) -> Table:
    """A CSV or .csv.gz. Raises `CsvError` naming column and row (1 is the header's)."""
    rows, left_out, digest = read_columns(source)
    given = [name for name in SIGNALS if name in rows]
    if len(given) != 1:
        what = "none is there" if not given else f"{' and '.join(given)} are there"
        raise CsvError(f"exactly one of the columns {', '.join(SIGNALS)} is needed; {what}")
    rows = rows.rename(columns={given[0]: signal(0)}).assign(**{saturated(0): 0.0})
    return Table(rows, {DEVICE: (SIGNALS[given[0]],)}, tuple(left_out), sha256=digest)


def cut(table: Table, tare_s: float | None = None) -> CsvRecording:
    """The recording's stations, the mean of the first ``tare_s`` of each as its zero.

    Raises `CsvError` naming column and row (1 is the header's).
    """
    if not len(table.rows):
        raise CsvError("no rows below the column names")
    notes = list(table.notes)
    if table.left_out:
        notes.append(f"columns left out: {', '.join(table.left_out)}")
    table = table._replace(rows=_in_order(table.rows, notes))
    devices, presses = _presses(table, notes)
    presses = _apart(_once(presses, notes), notes)
    if tare_s is not None:
        presses = [_tared(press, tare_s) for press in presses]
    if len(presses) == 1 and (places := _places_in_one(table.rows)):
        notes.append(f"{places}: are they in metres?")
    return CsvRecording(tuple(presses), devices, table, tuple(notes))


def _tared(press: Press, tare_s: float) -> Press:
    """With the mean of its first ``tare_s`` taken as zero."""
    tared = {}
    for device, stream in press.streams.items():
        if device in (DEVICE, TAXELS):
            first = stream.values[stream.time_s < press.start_s + tare_s]
            if not np.isfinite(first).any(axis=0).all():
                raise CsvError(
                    f"tare_s = {tare_s:g}: station {press.station + 1} has no reading in it"
                )
            stream = stream._replace(values=stream.values - np.nanmean(first, axis=0))
        tared[device] = stream
    return replace(press, streams=tared)


def _streams(table: Table) -> dict[str, tuple[tuple[Channel, ...], Array, Bools]]:
    """Channels, values (n, channels) and saturation (n, channels) of each device, in the file's
    units, depths in metres."""
    rows, number, streams = table.rows, 0, {}
    for device, channels in table.devices.items():
        own = range(number, number := number + len(channels))
        clipped = rows[[saturated(n) for n in own]].to_numpy(np.float64) > 0
        values = rows[[signal(n) for n in own]].to_numpy(np.float64)
        streams[device] = (channels, values, clipped)
    unclipped = np.zeros((len(rows), 1), bool)
    for name, channel, factor in (
        (REFERENCE, Channel(REFERENCE, "", REFERENCE), 1.0),
        (DEPTH, Channel("depth", "m", "depth"), 1e-3),
    ):
        if name == REFERENCE in rows or (name in rows and rows[name].notna().any()):
            values = factor * rows[[name]].to_numpy(np.float64)
            streams[channel.name] = ((channel,), values, unclipped)
    return streams


def _in_order(rows: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """With times that ascend within each station; without stations a clock that starts anew goes
    on where it was."""
    time_s = _whole(rows, "time_s").copy()
    labels = rows["station"].to_numpy(np.float64) if "station" in rows else np.zeros(len(rows))
    steps_s = np.diff(time_s)
    back = np.flatnonzero((steps_s < 0) & (np.diff(labels) == 0)) + 1
    if not len(back):
        return rows
    step_s = float(np.median(steps_s[steps_s > 0])) if (steps_s > 0).any() else 0.0
    if "station" not in rows and (time_s[back] <= time_s[0] + step_s).all():
        for at in back:
            time_s[at:] += time_s[at - 1] + step_s - time_s[at]
        notes.append(
            f"the times start anew {len(back)} times; each is put after the one before; if these "
            "are presses of their own, say so by a column 'station'"
        )
        return rows.assign(time_s=time_s)
    notes.append(f"{len(back)} times go back; the samples are put in the order of their times")
    stretch = np.concatenate([[0], np.cumsum(np.diff(labels) != 0)])
    return rows.iloc[np.lexsort((time_s, stretch))].reset_index(drop=True)


def _presses(whole: Table, notes: list[str]) -> tuple[dict[str, tuple[Channel, ...]], list[Press]]:
    """The devices, and the table cut into stations, rows without a reading left out."""
    table, streams = whole.rows, _streams(whole)
    time_s = _whole(table, "time_s")
    labels = _labels(table)
    at_stations = labels[labels != BETWEEN]
    if not len(at_stations):
        raise CsvError(f"column 'station': {BETWEEN} in every row, which is between two stations")
    if len(at_stations) < len(labels):
        left_out = len(labels) - len(at_stations)
        notes.append(f"{left_out} rows between stations ({BETWEEN}) are left out")
    first_number = min(int(at_stations.min()), 1)  # what is printed counts from 1, a run from 0
    starts = np.flatnonzero(np.diff(labels, prepend=labels[0] - 1))
    fresh = np.diff(time_s, prepend=-np.inf) > 0
    fresh[starts] = True
    known = {
        device: fresh & np.isfinite(values).any(axis=1)
        for device, (_, values, _) in streams.items()
    }
    presses: dict[int, Press] = {}
    for first, end in pairwise([*starts.tolist(), len(labels)]):
        number, part = int(labels[first]), slice(first, end)
        if number == BETWEEN:
            continue
        rows, times, readings = table.iloc[part], time_s[part], int(known[DEVICE][part].sum())
        if number in presses:
            raise CsvError(
                f"row {first + 2}: station {number} again; its rows must follow each other"
            )
        if readings < MIN_READINGS:
            how = (
                "sort the rows by station and time"
                if "station" in table
                else "a column 'station' says which rows belong together"
            )
            raise CsvError(
                f"row {first + 2}: station {number} has only {readings} readings, at least "
                f"{MIN_READINGS} are needed; {how}"
            )
        steps = np.diff(times)
        presses[number] = Press(
            number - first_number,
            1e-3 * _middle(rows, "x_mm"),
            1e-3 * _middle(rows, "y_mm"),
            {
                device: Stream(time_s[at], values[at], clipped[at])
                for device, (_, values, clipped) in streams.items()
                for at in [first + np.flatnonzero(known[device][part])]
            },
            float(times[0]),
            float(times[-1] + np.median(steps[steps > 0])),
            _phases(rows, times) if PHASE in rows else _phases_by_depth(rows, times),
        )
    read, beside = known[DEVICE], known.get(REFERENCE, np.zeros(len(labels), bool))
    for without, what in (
        (fresh & ~read & ~beside, "rows without a reading are left out"),
        (~read & beside, "rows have a reference and no reading"),
    ):
        if (count := int(without[labels != BETWEEN].sum())) and not whole.merged:
            notes.append(f"{count} {what}")
    if doubled := int((~fresh)[labels != BETWEEN].sum()):
        why = ": are two streams in one table?" if 3 * doubled > len(at_stations) else ""
        notes.append(f"{doubled} rows with the time of the row before are left out{why}")
    return {device: channels for device, (channels, _, _) in streams.items()}, [*presses.values()]


def _once(presses: list[Press], notes: list[str]) -> list[Press]:
    """Without presses that repeat all of another's readings, at its place and times: a table was
    pasted twice. A coarse sensor may read the same few values again."""
    different: dict[object, Press] = {}
    for press in presses:
        columns = (column for stream in press.streams.values() for column in stream)
        all_of_it = (f"{press.x_m} {press.y_m}", *(column.tobytes() for column in columns))
        telling = math.isfinite(press.x_m) and len(np.unique(press.signal.values)) >= MIN_VALUES
        different.setdefault(all_of_it if telling else press.station, press)
    if repeated := len(presses) - len(different):
        notes.append(f"stations that repeat others reading by reading are left out: {repeated}")
    return list(different.values())


def _places_in_one(rows: pd.DataFrame) -> str:
    """Of a table of one station: several places that count as one, in words; "" without."""
    x_mm = rows["x_mm"].dropna().to_numpy() if "x_mm" in rows else np.empty(0)
    places = np.unique(x_mm)
    # each is held for a while; a stage that trembles is elsewhere in every row
    if "station" in rows or not MIN_PLACES <= len(places) <= len(x_mm) / MIN_ROWS_EACH:
        return ""
    return f"x_mm: {len(places)} places span {np.ptp(places):.2g} mm in all, and count as one"


def _phases(rows: pd.DataFrame, times: Array) -> tuple[tuple[float, int], ...]:
    """When each phase was entered: between its first sample and the one before."""
    numbers = _or_nothing(rows, PHASE)
    at, known = times[np.isfinite(numbers)], numbers[np.isfinite(numbers)].astype(int)
    at = np.concatenate([at[:1], (at[:-1] + at[1:]) / 2])
    entered = np.flatnonzero(np.diff(known, prepend=-1))
    return tuple(zip(at[entered].tolist(), known[entered].tolist(), strict=True))


def _phases_by_depth(rows: pd.DataFrame, times: Array) -> tuple[tuple[float, int], ...]:
    """When the tip went in, was held, and was lifted, of a press whose depths are known from the
    surface on; else nothing."""
    depth = _or_nothing(rows, DEPTH)
    times, depth = times[np.isfinite(depth)], depth[np.isfinite(depth)]
    near = DEPTH_SHARE * depth.max(initial=0.0)
    if not len(depth) or near <= 0 or depth[0] > near:
        return ()
    held = np.flatnonzero(depth >= depth.max() - near)
    still = depth[held[len(held) // 4 : -(len(held) // 4) or None]]
    held = np.flatnonzero(depth >= np.median(still) - SIGMAS * still.std() - ROUNDING_MM)
    first, last = int(held[0]), int(held[-1])
    began = int(np.flatnonzero(depth[:first] <= 0)[-1:].sum())  # the last at the surface
    entered = [(times[began], Phase.INDENTING), (times[first], Phase.HOLDING)]
    if last + 1 < len(times):
        entered.append((times[last + 1], Phase.RETRACTING))
    return tuple((float(at), tuple(Phase).index(phase)) for at, phase in entered)


def _apart(presses: list[Press], notes: list[str]) -> list[Press]:
    """Stations one after the other in time: those that are not are shifted."""
    placed: list[Press] = []
    for press in presses:
        shift_s = 0.0
        if placed:
            last = placed[-1]
            if press.start_s > max(s.time_s[-1] for s in last.streams.values() if len(s.time_s)):
                placed[-1] = replace(last, end_s=min(last.end_s, press.start_s))
            else:
                shift_s = last.end_s + GAP_S - press.start_s
        placed.append(
            replace(
                press,
                streams={
                    device: stream._replace(time_s=stream.time_s + shift_s)
                    for device, stream in press.streams.items()
                },
                start_s=press.start_s + shift_s,
                end_s=press.end_s + shift_s,
                phases=tuple((at + shift_s, number) for at, number in press.phases),
            )
        )
    moved = sum(a.start_s != b.start_s for a, b in zip(presses, placed, strict=True))
    if moved:
        notes.append(f"{moved} stations did not follow in time; put {GAP_S:g} s apart")
    return placed


def _labels(table: pd.DataFrame) -> Ints:
    """The station of each row (n,)."""
    if "station" in table:
        stations = _whole(table, "station")
        wrong = (stations % 1 != 0) | (stations < BETWEEN) | (stations > MAX_STATION)
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise CsvError(
                f"row {row + 2}, column 'station': {stations[row]:g}; allowed are whole numbers "
                f"from 0 to {MAX_STATION}, and {BETWEEN} between two stations"
            )
        return stations.astype(np.int64)
    moved = np.zeros(len(table), bool)
    places = {name: _whole(table, name) for name in ("x_mm", "y_mm") if name in table}
    for at in places.values():
        moved |= np.abs(np.diff(at, prepend=at[0])) > 1e3 * SAME_PLACE_M
    labels = np.cumsum(moved).astype(np.int64)
    for name, at in places.items():
        _check_drift(name, at, labels)
    return labels + 1


def _check_drift(name: str, at: Array, labels: Ints) -> None:
    """A probe that was recorded on its way, too, moves by little from row to row: raise `CsvError`
    instead of taking stations and the ways between them for one."""
    firsts = np.flatnonzero(np.diff(labels, prepend=-1))
    far = np.abs(at - at[firsts][labels]) > MAX_DRIFT_MM
    if far.any():
        row = int(np.flatnonzero(far)[0])
        first = int(firsts[labels[row]])
        raise CsvError(
            f"row {row + 2}, column {name!r}: {at[row]:g}, slowly moved from {at[first]:g} in row "
            f"{first + 2}; leave out the rows on the way, or say by a column 'station' which rows "
            "belong together"
        )


def _whole(table: pd.DataFrame, name: str) -> Array:
    """A column that must have a number in every row."""
    values: Array = table[name].to_numpy(np.float64)
    missing = np.flatnonzero(np.isnan(values))
    if len(missing):
        raise CsvError(f"row {missing[0] + 2}, column {name!r}: every row needs a number")
    return values


def _or_nothing(rows: pd.DataFrame, name: str) -> Array:
    """A column (n,), NaN where it is not there."""
    return np.asarray(rows[name] if name in rows else np.full(len(rows), np.nan), np.float64)


def _middle(rows: pd.DataFrame, name: str) -> float:
    return float(np.median(_whole(rows, name))) if name in rows else math.nan
