"""The taxels of a device as one array over time, row and column, and back as channels."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from drivers import Channel
from drivers.core.array_layout import taxel_places
from drivers.core.extras import needs
from probe.storage.distinct_names import channel_names

with needs("data", "an array of taxels"):
    import xarray as xr

TAXELS = "taxels"
DIMENSIONS = ("time_s", "row", "column")
ENDINGS = ("", "_saturated")


def layout(channels: Sequence[Channel]) -> dict[str, tuple[int, int]]:
    """Row and column by the name of each channel that is a taxel; of none where their names do not
    say it, or they differ in more than in their places."""
    own = [channel for channel in channels if channel.role == "taxel"]
    places = taxel_places([channel.name for channel in own])
    alike = len({(channel.unit, channel.simulated) for channel in own}) == 1
    if places is None or not alike or TAXELS in channel_names(channels):
        return {}
    return {
        channel.name: (int(row), int(column))
        for channel, (row, column) in zip(own, places, strict=True)
    }


def gathered(data: xr.Dataset, channels: Sequence[Channel]) -> xr.Dataset:
    """``data`` with ``taxels`` and ``taxels_saturated`` (time_s, row, column) in place of variables
    for each; a cell that is no taxel is NaN. The attribute ``channels`` names them row by row."""
    places = layout(channels)
    if not places:
        return data
    names = sorted(places, key=places.__getitem__)
    where = np.array([places[name] for name in names])
    shape = (data.sizes["time_s"], *(where.max(axis=0) + 1))
    said = {**data[names[0]].attrs, "channels": " ".join(names)}
    arrays: dict[str, Any] = {}
    for ending, empty in zip(ENDINGS, (np.nan, False), strict=True):
        table = np.full(shape, empty)
        for name, (row, column) in places.items():
            table[:, row, column] = data[f"{name}{ending}"]
        arrays[f"{TAXELS}{ending}"] = (DIMENSIONS, table, said if not ending else {})
    rest = data.drop_vars([f"{name}{ending}" for name in names for ending in ENDINGS])
    return rest.assign(arrays)


def scattered(data: xr.Dataset) -> xr.Dataset:
    """The reverse of `gathered`: each taxel a variable with its own name.

    Raises ValueError where the attribute ``channels`` does not fit the array.
    """
    if TAXELS not in data or data[TAXELS].dims != DIMENSIONS:
        return data
    said = dict(data[TAXELS].attrs)
    listed = str(said.pop("channels", ""))
    names, shape = listed.split(), data[TAXELS].shape
    places = taxel_places(names)
    if places is None or (places.max(axis=0) >= shape[1:]).any():
        raise ValueError(f"{TAXELS} of shape {shape} have channels {listed[:40]!r}")
    each: dict[str, Any] = {}
    for name, (row, column) in zip(names, places, strict=True):
        for ending in ENDINGS:
            values = data[f"{TAXELS}{ending}"].to_numpy()[:, row, column]
            each[f"{name}{ending}"] = ("time_s", values, said if not ending else {})
    gone = [f"{TAXELS}{ending}" for ending in ENDINGS]
    return data.drop_vars(gone).drop_vars(["row", "column"], errors="ignore").assign(each)
