"""Of an exported run's devices, the samples of those channels that the run was judged on.

A device is a Dataset as `probe.storage.tables.samples` gives it, its phases as numbers.
"""

import json
from collections.abc import Callable, Collection, Mapping

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
from probe.storage.tables import attributes

with needs("data", "palpate import"):
    import pandas as pd
    import xarray as xr

LABELS = ["time_s", "station", "attempt"]
SHOWN = 8  # channels named in an error: an array has hundreds


def device_of(
    channels: Mapping[str, Channel], columns: Collection[str], read: Callable[[str], Array]
) -> xr.Dataset:
    """The device of a table: its ``channels`` by their columns, and what of the other ``columns``
    is known; ``read`` gives a column (n,)."""
    marks = [f"{channel.name}_saturated" for channel in channels.values()]
    others = [name for name in (*LABELS, *PER_STATION, *marks) if name in columns]
    data = xr.Dataset({name: ("time_s", read(name)) for name in others})
    if "phase" in columns:
        data = data.assign({PHASE: ("time_s", phase_numbers(read("phase")))})
    return data.assign(
        {
            channel.name: ("time_s", read(column), attributes(channel))
            for column, channel in channels.items()
        }
    )


def channels_of(data: xr.Dataset) -> list[Channel]:
    """The channels among a device's variables."""
    return [
        Channel(
            str(name),
            str(said.get("units", "")),
            str(said["role"]),
            simulated=bool(said.get("simulated", 0)),
        )
        for name, said in ((name, one.attrs) for name, one in data.data_vars.items())
        if "role" in said
    ]


def phase_numbers(phases: Array) -> Array:
    """Phases by their names as numbers, NaN for words of others; numbers as they are."""
    if phases.dtype.kind in "iuf":
        return phases.astype(np.float64)
    numbers = {str(phase): n for n, phase in enumerate(Phase)}
    return np.asarray(pd.Series(phases).astype(str).map(numbers), np.float64)


def judged(devices: Mapping[str, xr.Dataset], tactile: str | None) -> Table:
    """The last attempts at each station, of the ``tactile`` device where the file says which it is.

    Forces before pressures, these before taxels, as the run's own rule has it; with the first
    reference. Raises `CsvError`.
    """
    data = devices[name := _chosen(devices, tactile)]
    listed = channels_of(data)
    try:
        picked = [listed[n] for n in stress_conversion(listed, 1.0, any_unit=True).columns]
    except RunFileError as error:
        raise CsvError(f"{name}: {error}") from None
    added: dict[str, Array | float] = {}
    for n, channel in enumerate(picked):
        added[signal(n)] = _readings(name, data, channel)
        clipped = f"{channel.name}_saturated"
        added[saturated(n)] = _numbers(data, clipped) if clipped in data else 0.0
    added |= {other: _numbers(data, other) for other in (PHASE, *PER_STATION) if other in data}
    labels = _labelled(data)
    rows = pd.concat([labels, pd.DataFrame(added, labels.index)], axis=1)
    rows = _with_reference(rows, name, devices)
    merged = len(rows) > len(labels)
    return placed(Table(_last_attempts(rows), {DEVICE: tuple(picked)}, merged=merged))


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


def _chosen(devices: Mapping[str, xr.Dataset], tactile: str | None) -> str:
    """The device that the run was judged on."""
    channels = {name: channels_of(data) for name, data in devices.items()}
    feels = [name for name, own in channels.items() if any(c.role in FORCE_ROLES for c in own)]
    there = "; ".join(f"{name} ({_some([c.name for c in own])})" for name, own in channels.items())
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


def _numbers(data: xr.Dataset, name: str) -> Array:
    return data[name].to_numpy().astype(np.float64)


def _labelled(data: xr.Dataset) -> pd.DataFrame:
    rows = pd.DataFrame({name: data[name].to_numpy() for name in LABELS if name in data})
    check_size(rows["time_s"].to_numpy(np.float64), "time_s", "s")
    return rows


def _readings(device: str, data: xr.Dataset, channel: Channel) -> Array:
    """A channel's readings; an infinite one is none."""
    values = _numbers(data, channel.name)
    values[np.isinf(values)] = np.nan
    check_size(values, f"{device}/{channel.name}".lstrip("/"), channel.unit)
    return values


def _with_reference(
    rows: pd.DataFrame, tactile: str, devices: Mapping[str, xr.Dataset]
) -> pd.DataFrame:
    """Both in one table, in time: the reference may be of another device with times of its own."""
    for name, data in devices.items():
        for channel in channels_of(data):
            if channel.role == REFERENCE:
                reference = {REFERENCE: _readings(name, data, channel)}
                if name == tactile:
                    return rows.assign(**reference)
                other = _labelled(data).assign(**reference)
                merged = rows.merge(other, on=LABELS, how="outer")
                return merged.sort_values("time_s", kind="stable")
    return rows


def _last_attempts(rows: pd.DataFrame) -> pd.DataFrame:
    if "station" not in rows:
        return rows
    rows = rows[rows["station"] >= 0]
    if "attempt" not in rows:
        return rows
    last = rows.groupby("station")["attempt"].transform("max")
    return rows[rows["attempt"] == last].drop(columns="attempt")
