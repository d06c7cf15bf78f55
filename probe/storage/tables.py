"""A run as labelled tables and arrays: every quantity with its unit."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from drivers import Block, Channel
from drivers.core.extras import needs
from probe.core.contact_stress import simulated_channels, tactile_device, tactile_or_none
from probe.core.errors import RunFileError
from probe.core.events import (
    Event,
    PhaseEntered,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.core.finding_words import reach
from probe.core.recording import Station
from probe.storage.distinct_names import channel_names
from probe.storage.taxel_arrays import scattered

with needs("data", "a run as tables and arrays"):
    import pandas as pd
    import xarray as xr

SIZES = ["level_pa", "level_low_pa", "level_high_pa", "pulse_pa", "pulse_low_pa", "pulse_high_pa",
         "note"]  # fmt: skip
MAX_SAMPLES = 100_000_000  # in memory at once, times channels


def stations(
    run: RunStarted, events: Iterable[Event], depths_m: Mapping[int, float]
) -> pd.DataFrame:
    """One press per row, in the order in which they were made.

    Columns: station (from 1), attempt, x_mm, y_mm, started_s, ended_s (NaN: broken off by a crash),
    complete, samples (of the device that feels; 0 where none does), depth_mm (median of the hold,
    NaN where unknown, and of attempts that are not judged). ``depths_m`` are those by index.
    """
    device = tactile_or_none(run.channels)
    counted: Counter[tuple[int, int]] = Counter()
    ended: dict[tuple[int, int], StationEnded] = {}
    started: list[StationStarted] = []
    for event in events:
        match event:
            case StationStarted():
                started.append(event)
            case StationEnded():
                ended[event.station, event.attempt] = event
            case Samples(name, block, int(station), int(attempt)) if name == device:
                counted[station, attempt] += len(block.time_s)
    keys = [(e.station, e.attempt) for e in started]
    ends = [ended.get(key) for key in keys]
    judged = {key[0]: n for n, (key, e) in enumerate(zip(keys, ends, strict=True))
              if e is not None and e.complete}  # fmt: skip
    depth_mm = np.full(len(keys), np.nan)
    for index, row in judged.items():
        depth_mm[row] = 1e3 * depths_m.get(index, np.nan)
    return pd.DataFrame(
        {
            "station": np.array([k[0] + 1 for k in keys], int),
            "attempt": np.array([k[1] for k in keys], int),
            "x_mm": np.array([1e3 * e.x_m for e in started], float),
            "y_mm": np.array([1e3 * e.y_m for e in started], float),
            "started_s": np.array([e.time_s for e in started], float),
            "ended_s": np.array([np.nan if e is None else e.time_s for e in ends], float),
            "complete": np.array([e is not None and e.complete for e in ends], bool),
            "samples": np.array([counted[key] for key in keys], int),
            "depth_mm": depth_mm,
        }
    )


def judged(table: pd.DataFrame, found: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """``table`` of `stations` with what detection says of each: the ``stations`` of its JSON.

    Columns: level_pa and pulse_pa with the ends of their 95 % intervals (level_low_pa,
    level_high_pa, pulse_low_pa, pulse_high_pa), and note. A pulse that was not seen is NaN, and its
    interval reaches from 0 to what it is below. Presses that are not judged have NaN and no note.
    """
    of = {one["station"]: _sizes(one) for one in found}
    latest = table[table["complete"]].groupby("station").tail(1)
    rows = pd.DataFrame(
        [of.get(number, {}) for number in latest["station"]], index=latest.index, columns=SIZES
    )
    joined = table.join(rows.astype(dict.fromkeys(SIZES[:-1], float)))
    return joined.assign(note=joined["note"].fillna("").astype(str))


def _sizes(station: Mapping[str, Any]) -> dict[str, Any]:
    level, pulse = station["baseline_pa"], station["pulse_pa"]
    around = reach(station["baseline_sd_pa"])
    sizes = {"level_pa": level, "note": station["note"]}
    if None not in (level, around):
        sizes |= {"level_low_pa": level - around, "level_high_pa": level + around}
    if (below := station["pulse_below_pa"]) is not None:
        return sizes | {"pulse_low_pa": 0.0, "pulse_high_pa": below}
    if None not in (pulse, around := reach(station["pulse_sd_pa"])):
        sizes |= {"pulse_low_pa": max(pulse - around, 0.0), "pulse_high_pa": pulse + around}
    return sizes | {"pulse_pa": pulse}


def samples(
    run: RunStarted, events: Iterable[Event], device: str | None, station: int | None
) -> xr.Dataset:
    """The samples of one device along ``time_s``, with ``station``, ``attempt`` and ``phase``.

    Of all stations, or of one by its number from 1.
    Each channel is a variable with the attributes ``units``, ``role`` and ``simulated``; a name
    that is taken gets a number. ``NAME_saturated`` marks its clipped samples. Between stations,
    ``station`` and ``attempt`` are -1. Raises `RunFileError` for a device or station that is not
    in the run, and where there are more than `MAX_SAMPLES` to hold in memory.
    """
    device = device or tactile_device(run.channels)
    if device not in run.channels:
        raise RunFileError(f"no device {device!r}; it has {', '.join(run.channels)}")
    channels = run.channels[device]
    parts: list[Samples] = []
    phases: list[tuple[float, str]] = [(-np.inf, "idle")]
    known: set[int] = set()
    held = 0
    for event in events:
        match event:
            case RunStarted(began_s):  # a session that was killed has not said when its phase ended
                phases.append((began_s, "idle"))
            case PhaseEntered(entered_s, phase, _):
                phases.append((entered_s, str(phase)))
            case StationStarted(_, number):
                known.add(number + 1)
            case Samples(name, block, at) if name == device and (
                station is None or at == station - 1
            ):
                if block.values.shape[1] != len(channels):
                    raise RunFileError(f"a block of {device} lacks a channel")
                parts.append(event)
                held += block.values.size
                if held > MAX_SAMPLES:
                    raise RunFileError("too large for memory; read it by station")
    if station is not None and station not in known:
        numbers = f"{min(known)} to {max(known)}" if known else "none"
        raise RunFileError(f"no station {station}; it has {numbers}")
    time_s = np.concatenate([p.block.time_s for p in parts] or [np.empty(0)])
    empty = np.empty((0, len(channels)))
    values = np.concatenate([p.block.values for p in parts] or [empty])
    saturated = np.concatenate([p.block.saturated for p in parts] or [empty.astype(bool)])
    labels = np.array(
        [
            (-1 if p.station is None else p.station + 1, -1 if p.attempt is None else p.attempt)
            for p in parts
        ],
        np.int64,
    ).reshape(-1, 2)
    number, attempt = np.repeat(labels, [len(p.block.time_s) for p in parts], axis=0).T
    names = np.array([name for _, name in phases])
    entered = np.searchsorted([at for at, _ in phases], time_s, side="right") - 1
    variables: dict[str, tuple[Any, ...]] = {}
    for n, (name, channel) in enumerate(zip(channel_names(channels), channels, strict=True)):
        variables[name] = ("time_s", values[:, n], attributes(channel))
        variables[f"{name}_saturated"] = ("time_s", saturated[:, n])
    along = xr.Dataset(
        coords={
            "time_s": ("time_s", time_s, {"units": "s", "long_name": "time on the scan's clock"}),
            "station": ("time_s", number),
            "attempt": ("time_s", attempt),
            "phase": ("time_s", names[entered]),
        },
        attrs={
            "device": device,
            "started_utc": run.started_utc,
            "simulated": ", ".join(simulated_channels(run.channels)),
        },
    )
    return along.assign(variables)  # one by one, hundreds of taxels take seconds


def with_depth(along: xr.Dataset, stations: Iterable[Station]) -> xr.Dataset:
    """``along`` of `samples` with ``depth_mm`` (n,): how deep the tip was below the surface at that
    time, of presses that are judged; NaN elsewhere and where no device tells its position."""
    time_s, number = along["time_s"].to_numpy(), along["station"].to_numpy()
    depth_mm = np.full(len(time_s), np.nan)
    for one in stations:
        if not len(one.time_s):
            continue
        first, last = np.searchsorted(time_s, one.time_s[[0, -1]])
        part = slice(int(first), int(last) + 1)
        deep_mm = 1e3 * np.interp(time_s[part], one.time_s, one.depth_m, np.nan, np.nan)
        depth_mm[part] = np.where(number[part] == one.index + 1, deep_mm, np.nan)
    said = {"units": "mm", "long_name": "depth of the tip below the surface"}
    return along.assign(depth_mm=("time_s", depth_mm, said))


def with_samples(
    run: RunStarted, events: Iterable[Event], changed: xr.Dataset | pd.DataFrame
) -> Iterator[Event]:
    """``events`` with the rows of ``changed`` in place of the samples of its device.

    ``changed`` is what `samples` gives. A press with no row left is left out. Raises `RunFileError`
    for a device or column that is missing, and for times that go back; `TypeError` for no table.
    """
    if not isinstance(changed, xr.Dataset | pd.DataFrame):
        raise TypeError(
            "samples: what Run.samples gives is needed, or a pandas table of it; what was given is "
            f"of type {type(changed).__name__}"
        )
    device = str(changed.attrs.get("device") or tactile_device(run.channels))
    if device not in run.channels:
        raise RunFileError(f"samples of {device!r}: the run has {', '.join(run.channels)}")
    names = channel_names(run.channels[device])
    table = changed.reset_index() if isinstance(changed, pd.DataFrame) else scattered(changed)
    needed = ["time_s", "station", "attempt", *names, *(f"{name}_saturated" for name in names)]
    if lacking := [name for name in needed if name not in table]:
        raise RunFileError(f"samples of {device!r}: no {', '.join(lacking)}")
    time_s = np.asarray(table["time_s"], float)
    values = np.empty((len(time_s), len(names)))
    saturated = np.empty(values.shape, bool)
    for n, name in enumerate(names):
        values[:, n], saturated[:, n] = table[name], table[f"{name}_saturated"]
    if not (np.diff(time_s) >= 0).all():
        raise RunFileError(f"samples of {device!r}: time_s must ascend")
    presses = np.stack([np.asarray(table["station"]), np.asarray(table["attempt"])], axis=1)
    for event in events:
        if isinstance(event, StationEnded):
            rows = (presses == (event.station + 1, event.attempt)).all(axis=1)
            block = Block(time_s[rows], values[rows], saturated[rows])
            yield Samples(device, block, event.station, event.attempt)
            yield replace(event, complete=event.complete and bool(rows.any()))
        elif not isinstance(event, Samples) or event.device != device:
            yield event


def attributes(channel: Channel) -> dict[str, str | int]:
    """What a variable says of its channel; netCDF knows no booleans."""
    return {"units": channel.unit, "role": channel.role, "simulated": int(channel.simulated)}
