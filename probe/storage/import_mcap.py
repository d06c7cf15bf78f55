"""Samples in MCAP files that ``palpate export`` wrote: to the bit, with the plan's places."""

import json
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from drivers import Channel
from drivers.core.extras import needs
from probe.core.contact_stress import tactile_or_none
from probe.core.places import planned
from probe.storage.import_device import channels_of, device_of, face_mm2_of, judged, placed
from probe.storage.import_table import DEPTH, PLACES, Table

with needs("data", "palpate import"):
    import pandas as pd
    import xarray as xr

SAMPLE = "palpate_msgs/msg/"
ROLE = "role of "
KINDS = {"float64": "<f8", "int32": "<i4", "uint8": "<u1", "bool": "<u1"}


def own_mcap(source: Path) -> Table | None:
    """The samples of the device that the run was judged on; None of a file of others."""
    with needs("export", "MCAP"):
        from mcap.exceptions import McapError
        from mcap.reader import make_reader

    with source.open("rb") as file:
        try:
            reader = make_reader(file)
            summary = reader.get_summary()
        except (McapError, OSError):  # a recorder that died wrote no end
            return None
        if summary is None:
            return None
        kinds = {number: schema.name for number, schema in summary.schemas.items()}
        listed = [channel for _, channel in sorted(summary.channels.items())]
        ours = [c.topic for c in listed if kinds.get(c.schema_id, "").startswith(SAMPLE)]
        return _own_samples(reader, summary, ours) if ours else None


def _own_samples(reader: Any, summary: Any, topics: list[str]) -> Table:
    channels = {c.topic: c for c in summary.channels.values()}
    devices = {topic: _device(reader, summary, channels[topic]) for topic in topics}
    said = {one.name: one.metadata for one in reader.iter_metadata()}.get("palpate", {})
    first = tactile_or_none({topic: tuple(channels_of(own)) for topic, own in devices.items()})
    table = judged(devices, said.get("tactile") or first)
    attached = {a.name: a.data for a in reader.iter_attachments()}
    config = attached.get("config.json", b"{}")
    places = planned(json.loads(config))
    at_mm = {
        name: {index + 1: round(1e3 * place[n], 9) for index, place in places.items()}
        for n, name in enumerate(PLACES)
    }
    if "stations.csv" in attached:  # exports of older versions have none
        stations = pd.read_csv(BytesIO(attached["stations.csv"]))
        at_mm[DEPTH] = dict(zip(stations["station"], stations[DEPTH], strict=True))
    return placed(table, at_mm)._replace(face_mm2=face_mm2_of(config))


def _device(reader: Any, summary: Any, channel: Any) -> xr.Dataset:
    from probe.storage.export_mcap import layout_of  # here: it needs the extra

    layout = layout_of(dict(_fields(summary.schemas[channel.schema_id].data.decode())))
    said = channel.metadata
    messages = reader.iter_messages([channel.topic])
    samples = np.frombuffer(b"".join(m.data[4:][: layout.itemsize] for *_, m in messages), layout)
    columns = layout.names or ()
    channels = {
        name: Channel(
            name, said.get(f"unit of {name}", ""), role, simulated=bool(said.get("simulated"))
        )
        for name in columns
        if (role := said.get(ROLE + name)) is not None
    }
    return device_of(channels, columns, lambda name: samples[name].copy())


def _fields(text: str) -> Iterator[tuple[str, str]]:
    """Name and kind of each number of the first message of a ROS 2 definition."""
    for line in text.split("=" * 80)[0].splitlines():
        words = line.partition("#")[0].split()
        if len(words) == 2 and words[0] in KINDS and "=" not in words[1]:
            yield words[1], KINDS[words[0]]
