"""Of an exported run's devices, the samples of those channels that the run was judged on."""

import json
from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple

import numpy as np

from drivers import Channel
from drivers.core.arrays import Array
from drivers.core.extras import needs
from probe.core.contact_stress import FORCE_ROLES, stress_conversion
from probe.core.errors import RunFileError
from probe.core.events import Phase
from probe.storage.import_table import (
    DEVICE,
    PER_STATION,
    PHASE,
    REFERENCE,
    CsvError,
    Table,
    check_size,
    saturated,
    signal,
)

with needs("data", "palpate import"):
    import pandas as pd

LABELS = ["time_s", "station", "attempt"]
SHOWN = 8  # channels named in an error: an array has hundreds


class Device(NamedTuple):
    """A device's ``channels`` by their names, the ``columns`` that it has beside and how to
    ``read`` one (n,)."""

    channels: Mapping[str, Channel]
    columns: Collection[str]
    read: Callable[[str], Array]


def phase_numbers(phases: "pd.Series[str]") -> Array:
    """Phases by their names as numbers, NaN for words of others."""
    numbers = {str(phase): n for n, phase in enumerate(Phase)}
    return np.asarray(phases.astype(str).map(numbers), np.float64)


def judged(devices: Mapping[str, Device], tactile: str | None) -> Table:
    """The last attempts at each station, of the ``tactile`` device where the file says which it is.

    Forces before pressures, these before taxels, as the run's own rule has it; with the first
    reference. Raises `CsvError`.
    """
    device = devices[name := _chosen(devices, tactile)]
    listed = list(device.channels.items())
    try:
        picked = [listed[n] for n in stress_conversion([c for _, c in listed], 1.0).columns]
    except RunFileError as error:
        raise CsvError(f"{name}: {error}") from None
    added: dict[str, Array | float] = {}
    for n, (column, _) in enumerate(picked):
        added[signal(n)] = _readings(name, device, column)
        clipped = f"{column}_saturated"
        added[saturated(n)] = device.read(clipped) if clipped in device.columns else 0.0
    added |= {
        other: device.read(other) for other in (PHASE, *PER_STATION) if other in device.columns
    }
    labels = _labelled(device)
    rows = pd.concat([labels, pd.DataFrame(added, labels.index)], axis=1)
    rows = _with_reference(rows, name, devices)
    merged = len(rows) > len(labels)
    own = {DEVICE: tuple(channel for _, channel in picked)}
    return placed(Table(_last_attempts(rows), own, merged=merged))


def placed(table: Table, places: Mapping[str, Mapping[int, float]] | None = None) -> Table:
    """With the ``places`` and depths by station, where a file has them beside the samples; a run
    without has columns of them with nothing in it. Raises `CsvError`."""
    rows = table.rows
    for name, at_mm in (places or {}).items():
        rows = rows.assign(**{name: rows["station"].map(at_mm)})
    empty = [name for name in PER_STATION if name in rows and rows[name].isna().all()]
    rows = rows.drop(columns=empty)
    for name in PER_STATION:
        if name in rows:
            check_size(rows[name].to_numpy(np.float64), name, "mm")
    return table._replace(rows=rows)


def face_mm2_of(config: str | bytes) -> float | None:
    """The probe's face in a run's configuration."""
    face_mm2 = json.loads(config or "{}").get("face_mm2")
    return float(face_mm2) if face_mm2 else None


def _chosen(devices: Mapping[str, Device], tactile: str | None) -> str:
    """The device that the run was judged on."""
    feels = [
        name
        for name, device in devices.items()
        if any(c.role in FORCE_ROLES for c in device.channels.values())
    ]
    there = "; ".join(f"{name} ({_some(device.channels)})" for name, device in devices.items())
    if not feels:
        raise CsvError(
            f"no force, pressure or taxel channel is in it, so nothing was measured; it has {there}"
        )
    if tactile is not None and tactile not in feels:
        raise CsvError(
            f"the run was judged on {tactile!r}, of which no force, pressure or taxel channel is "
            f"in it; it has {there}; export the run again"
        )
    if tactile is None and len(feels) > 1:
        raise CsvError(
            f"does not say which of {', '.join(feels)} the run was judged on, as exports of older "
            f"versions; it has {there}; export the run again, or import the CSV of the one that "
            "is meant"
        )
    return tactile or feels[0]


def _some(names: Collection[str]) -> str:
    more = [f"and {len(names) - SHOWN} more"] if len(names) > SHOWN else []
    return ", ".join([*list(names)[:SHOWN], *more])


def _labelled(device: Device) -> pd.DataFrame:
    rows = pd.DataFrame({one: device.read(one) for one in LABELS if one in device.columns})
    check_size(rows["time_s"].to_numpy(np.float64), "time_s", "s")
    return rows


def _readings(name: str, device: Device, column: str) -> Array:
    """A channel's readings; an infinite one is none."""
    values = np.array(device.read(column), np.float64)
    values[np.isinf(values)] = np.nan
    check_size(values, f"{name}/{column}".lstrip("/"), device.channels[column].unit)
    return values


def _with_reference(
    rows: pd.DataFrame, tactile: str, devices: Mapping[str, Device]
) -> pd.DataFrame:
    """Both in one table, in time: the reference may be of another device with times of its own."""
    beside = (
        (name, column)
        for name, device in devices.items()
        for column, channel in device.channels.items()
        if channel.role == REFERENCE
    )
    if (found := next(beside, None)) is None:
        return rows
    name, column = found
    reference = {REFERENCE: _readings(name, devices[name], column)}
    if name == tactile:
        return rows.assign(**reference)
    other = _labelled(devices[name]).assign(**reference)
    return rows.merge(other, on=LABELS, how="outer").sort_values("time_s", kind="stable")


def _last_attempts(rows: pd.DataFrame) -> pd.DataFrame:
    if "station" not in rows:
        return rows
    rows = rows[rows["station"] >= 0]
    if "attempt" not in rows:
        return rows
    last = rows.groupby("station")["attempt"].transform("max")
    return rows[rows["attempt"] == last].drop(columns="attempt")
