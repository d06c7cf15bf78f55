"""What each column of a recording is: a mapping from our names to the file's, with its units.

``{"force_n": "Fz [mN]"}`` takes the file's column ``Fz [mN]``, or ``Fz`` and says its unit;
``"-Fz"`` turns the sign, ``"p*"`` and an array's name take all of an array.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from drivers import Channel
from drivers.core.array_layout import taxel_names
from drivers.core.arrays import Array
from drivers.core.extras import needs
from drivers.core.units import SI, to_si, units_of
from probe.storage.import_table import (
    ARRAYS,
    DEVICE,
    SIGNALS,
    TAXELS,
    UNITS,
    CsvError,
    Table,
    check_size,
    saturated,
    signal,
)

with needs("data", "palpate import"):
    import pandas as pd

MAX_RATE_OFF = 0.01
"""Share that a rate may be off its times: a heart rate is said to a whole beat, 1 of 100."""
MAX_TAXELS = 10_000  # as many as `drivers.taxels` takes
SHOWN = 30  # column names in an error
BRACKETS = re.compile(r"\s*[\[(]\s*(?![\d,]+[\])])([^\[\]()]*?)\s*[\])]\s*$")  # and no index


class Column(NamedTuple):
    """``values`` (n,), of an array (n, ...); the times (n,) of its stream and its unit where the
    file says them. Of a column of ``words`` they are numbers from 1, one for each word."""

    values: Array
    time_s: Array | None = None
    unit: str = ""
    words: bool = False


class Recording(NamedTuple):
    """Columns by their names, what was lost, in sentences, and which column is ``meant``, if only
    one of them is there, where nothing else is said."""

    columns: Mapping[str, Column]
    notes: tuple[str, ...] = ()
    meant: Mapping[str, Sequence[str]] = {}


class Asked(NamedTuple):
    """What is asked of a recording: `probe.storage.csv_import.import_csv` has the words."""

    mapping: Mapping[str, str | list[str]] = {}
    rate_hz: float | None = None
    topic: str | None = None
    layout: tuple[int, int] | None = None


class _Picked(NamedTuple):
    """The column of the file that is ``target``."""

    target: str
    name: str
    values: Array
    time_s: Array


def mapped(recording: Recording, asked: Asked) -> Table:
    """The columns that are asked for. Raises `CsvError`."""
    if unknown := [name for name in asked.mapping if name not in UNITS]:
        raise CsvError(f"--map {unknown[0]}: not known; allowed are {', '.join(UNITS)}")
    columns = {
        name: column
        for name, column in recording.columns.items()
        if asked.topic is None or name.startswith(asked.topic)
    }
    if not columns:
        raise CsvError(f"--topic {asked.topic}: not there; {_listed(recording.columns)}")
    notes = list(recording.notes)
    wanted = {name: name for name in UNITS if name in columns}
    if not any(name in {**SIGNALS, **ARRAYS} for name in (*asked.mapping, *wanted)):
        for name, candidates in recording.meant.items():
            present = [candidate for candidate in candidates if candidate in columns]
            wanted |= {name: present[0]} if len(present) == 1 else {}
    wanted |= {name: said for name, said in asked.mapping.items() if isinstance(said, str)}
    forces = [name for name in wanted if name in SIGNALS]
    arrays = [name for name in wanted if name in ARRAYS]
    if len(forces) > 1 or len(arrays) > 1 or not (forces or arrays):
        both = " and ".join(forces + arrays) or "none"
        raise CsvError(
            f"say which column is the signal, as --map force_n=COLUMN (one of "
            f"{', '.join([*SIGNALS, *ARRAYS])}; {both} is said); {_listed(columns)}"
        )
    times = _times(columns, asked, notes)
    picked = [
        _picked(columns, name, said, times, asked, notes)
        for name, said in wanted.items()
        if name != "time_s"
    ]
    devices: dict[str, tuple[Channel, ...]] = {}
    parts: list[_Picked] = []
    first = forces[0] if forces else arrays[0]
    count = 0
    for pick in sorted(picked, key=lambda pick: pick.target != first):
        if pick.target in SIGNALS:
            channels: tuple[Channel, ...] = (SIGNALS[pick.target],)
        elif pick.target in ARRAYS:
            channels = _taxels(pick, asked.layout, notes)
        else:
            parts.append(pick)
            continue
        devices[DEVICE if not devices else TAXELS] = channels
        for values in pick.values.reshape(len(pick.values), -1).T:
            parts.append(pick._replace(target=signal(count), values=values))
            count += 1
    rows = _together(parts, notes).assign(**{saturated(n): 0.0 for n in range(count)})
    merged = len(rows) > max(len(part.time_s) for part in parts)
    return Table(_timed(rows, notes), devices, notes=tuple(notes), merged=merged)


def _together(parts: list[_Picked], notes: list[str]) -> pd.DataFrame:
    """All in one table in time; each stream keeps its own rows."""
    streams: list[tuple[_Picked, dict[str, Array]]] = []
    for part in parts:
        own = next((c for head, c in streams if np.array_equal(head.time_s, part.time_s)), None)
        if own is None:
            streams.append((part, own := {"time_s": part.time_s}))
        own[part.target] = part.values
    if len(streams) == 1:
        return pd.DataFrame(streams[0][1])
    rows = pd.DataFrame({"time_s": []}, dtype=float)
    for head, own in streams:
        if (np.diff(head.time_s) < 0).any():
            raise CsvError(
                f"{head.name}: its times go back, and other streams have times of their own, so "
                "nothing says which readings belong together; cut the file there, or import one "
                "stream of it"
            )
        alone = _timed(pd.DataFrame(own), notes)
        fresh = ~alone["time_s"].duplicated()
        if lost := int((~fresh).sum()):
            notes.append(f"{head.name}: {lost} readings with the time of the one before left out")
        rows = rows.merge(alone[fresh], on="time_s", how="outer")
    rows = rows.sort_values("time_s", ignore_index=True)
    held = [name for name in ("x_mm", "y_mm", "station") if name in rows]
    return rows.assign(**rows[held].ffill().bfill())  # the last that was said holds on


def _timed(rows: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """Those that have a time."""
    known = np.isfinite(rows["time_s"].to_numpy(np.float64))
    if not known.all():
        notes.append(f"{int((~known).sum())} rows without a time are left out")
    kept: pd.DataFrame = rows[known]
    return kept


def _times(
    columns: Mapping[str, Column], asked: Asked, notes: list[str]
) -> list[tuple[str, Array]]:
    """Columns of times that are named, or the only one in a unit of time."""
    said = asked.mapping.get("time_s", "time_s" if "time_s" in columns else [])
    names = [said] if isinstance(said, str) else said
    if not names:
        own = [n for n, c in columns.items() if c.values.ndim == 1 and _unit(n, c) in TIMES]
        if len(own) == 1:
            names = own
            notes.append(f"times are those of {own[0]!r}")
    times = [_find(columns, "time_s", name, notes)[:2] for name in names]
    for name, values in times:
        check_size(values, name, "s")
    return times


def _picked(
    columns: Mapping[str, Column],
    target: str,
    said: str,
    times: list[tuple[str, Array]],
    asked: Asked,
    notes: list[str],
) -> _Picked:
    """The column of a target with its times: those named, the stream's own, or by the rate."""
    name, values, own = _find(columns, target, said, notes)
    check_size(values.ravel(), target, UNITS[target])
    fits = [(n, t) for n, t in times if len(t) == len(values)]
    if fits:  # of two streams of one length, the times beside it
        own = max(fits, key=lambda time: _shared(time[0], name))[1]
    elif times and own is None:
        lengths = ", ".join(f"{n}: {len(t)}" for n, t in times)
        raise CsvError(f"columns of different length ({lengths}, {name}: {len(values)})")
    if own is None:
        if asked.rate_hz is None:
            raise CsvError(
                f"{name} has no times: say --rate-hz, or --map time_s=COLUMN; {_listed(columns)}"
            )
        own = np.arange(len(values)) / asked.rate_hz
    elif asked.rate_hz is not None and target in {**SIGNALS, **ARRAYS}:
        _check_rate(name, own, asked.rate_hz)
    return _Picked(target, name, values, own)


def _check_rate(name: str, time_s: Array, rate_hz: float) -> None:
    """Raises `CsvError` for a rate that is not that of the times."""
    steps_s = np.diff(time_s[np.isfinite(time_s)])
    forward_s = steps_s[steps_s > 0]
    if not len(forward_s):
        return
    rates = 1 / float(np.median(forward_s)), 1 / float(np.mean(forward_s))
    if min(abs(rate / rate_hz - 1) for rate in rates) > MAX_RATE_OFF:
        raise CsvError(
            f"--rate-hz {rate_hz:g} is not the rate of {name}, whose times are {rates[0]:.6g} Hz; "
            "leave --rate-hz out, or say which column is time_s in which unit: "
            "--map time_s='COLUMN [ms]'"
        )


def _find(
    columns: Mapping[str, Column], target: str, said: str, notes: list[str]
) -> tuple[str, Array, Array | None]:
    """Name, values in the target's unit, and times of the column that is ``said``."""
    unit = ""
    if not (taken := _named(columns, said)) and (bracket := BRACKETS.search(said)):
        taken, unit = _named(columns, said[: bracket.start()]), bracket[1]
    if not taken and said.startswith("-"):
        name, values, time_s = _find(columns, target, said[1:].strip(), notes)
        return name, -values, time_s
    if not taken:
        raise CsvError(f"--map {target}={said}: no such column; {_listed(columns)}")
    if len(taken) > 1 and "*" not in said:
        raise CsvError(
            f"--map {target}={said}: there are {len(taken)} of that name: {', '.join(taken)}; "
            "say which by its whole name"
        )
    name, first = next(iter(taken.items()))
    if len({len(column.values) for column in taken.values()}) > 1:
        raise CsvError(f"--map {target}={said}: columns of different length: {', '.join(taken)}")
    if first.words and target != "station":
        raise CsvError(f"--map {target}={said}: a column of words; numbers are wanted")
    values = first.values
    if len(taken) > 1:
        values = np.column_stack([column.values for column in taken.values()])
    if values.ndim > 1 and target not in ARRAYS:
        raise CsvError(
            f"--map {target}={said}: an array of {_shape(values)}; say one of it, as "
            f"{name}[{','.join('0' * (values.ndim - 1))}]"
        )
    factor = _factor(target, name, _unit(name, first), unit, notes)
    return name if len(taken) == 1 else said, factor * values, first.time_s


def _named(columns: Mapping[str, Column], said: str) -> dict[str, Column]:
    """Columns of that name: whole, by a pattern, without its unit, or the last part of it; or one
    of an array, as ``pressure[2,5]``."""
    if said in columns:
        return {said: columns[said]}
    if "*" in said:
        pattern = re.compile(".*".join(map(re.escape, said.split("*"))) + r"\Z", re.DOTALL)
        return {name: column for name, column in columns.items() if pattern.match(name)}
    ends = (f"/{said}", f".{said}")
    fitting = {n: column for n, column in columns.items() if BRACKETS.sub("", n) == said}
    fitting = fitting or {n: column for n, column in columns.items() if n.endswith(ends)}
    if fitting or (index := re.search(r"\[(\d+(?:,\d+)*)\]$", said)) is None:
        return fitting
    at = tuple(map(int, index[1].split(",")))
    return {
        f"{name}{index[0]}": column._replace(values=np.moveaxis(column.values, 0, -1)[at])
        for name, column in _named(columns, said[: index.start()]).items()
        if len(at) == column.values.ndim - 1
        and all(n < size for n, size in zip(at, column.values.shape[1:], strict=True))
    }


TIMES = [unit for unit, (base, _) in SI.items() if base == "s"]


def _unit(name: str, column: Column) -> str:
    """As the file says it beside the column, or in its name."""
    bracket = BRACKETS.search(name)
    return column.unit or (bracket[1] if bracket else "")


def _factor(target: str, name: str, in_file: str, said: str, notes: list[str]) -> float:
    """From the column's unit to the target's. Raises `CsvError` for one of another kind."""
    if said and in_file and said != in_file:
        raise CsvError(f"--map {target}: the file says that {name} is in {in_file}, not in {said}")
    unit, wanted = (said or in_file).replace("µ", "u").replace("μ", "u"), UNITS[target]
    if not unit or not wanted or unit == wanted:
        return 1.0
    if unit not in SI:
        if said:
            raise CsvError(f"--map {target}: unit {unit!r} is not known; one of {_units(wanted)}")
        notes.append(f"the unit {unit!r} of {name} is not known; {wanted} is assumed")
        return 1.0
    (base, factor), (wanted_base, per) = SI[unit], to_si(wanted)
    if base != wanted_base:
        raise CsvError(f"--map {target}: {name} is in {unit}; wanted is one of {_units(wanted)}")
    return factor / per


def _units(wanted: str) -> str:
    return ", ".join(units_of(to_si(wanted)[0])) or wanted


def _taxels(
    array: _Picked, layout: tuple[int, int] | None, notes: list[str]
) -> tuple[Channel, ...]:
    """Channels as `drivers.taxels` names them, row by row."""
    shape = array.values.shape[1:]
    count = int(np.prod(shape))
    if not 1 <= count <= MAX_TAXELS:
        raise CsvError(f"{array.name}: {count} taxels; 1 to {MAX_TAXELS} are possible")
    if layout is None:
        layout = (shape[0], shape[1]) if len(shape) == 2 else (1, count)
        if len(shape) != 2 and count > 1:
            notes.append(
                f"{array.name}: the {count} taxels are taken as one row; --layout ROWSxCOLUMNS "
                "says how they lie"
            )
    rows, columns = layout
    if rows * columns != count:
        raise CsvError(
            f"--layout {rows}x{columns}: {rows * columns} taxels, but {array.name} has {count}"
        )
    unit = ARRAYS[array.target]
    return tuple(Channel(name, unit, "taxel") for name in taxel_names(rows, columns))


def _shared(a: str, b: str) -> int:
    """How many characters two names begin with together."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(a, b, strict=False)))


def _shape(values: Array) -> str:
    return " x ".join(map(str, values.shape[1:]))


def _listed(columns: Mapping[str, Column]) -> str:
    return f"it has {', '.join(_some(columns)) or 'no columns of numbers'}"


def _some(columns: Mapping[str, Column]) -> Iterator[str]:
    for n, (name, column) in enumerate(columns.items()):
        if n == SHOWN:
            yield f"and {len(columns) - SHOWN} more"
            return
        shape = f" ({_shape(column.values)})" if column.values.ndim > 1 else ""
        yield repr(name) + (" (words)" if column.words else shape)
