"""Streams of the Lab Streaming Layer's recorder (XDF), by pyxdf, each with its own times."""

import logging
import struct
from io import BytesIO
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import Any

import numpy as np

from drivers.core.extras import needs
from probe.storage.import_columns import Column, Recording
from probe.storage.import_table import CsvError

MAX_SAID = 1000  # what the library could not read, before it is forgotten
LENGTHS = {1: "<B", 4: "<I", 8: "<Q"}


def read_xdf(source: Path) -> Recording:
    """Every stream of numbers, as ``stream/channel`` and, of several, ``stream`` as an array."""
    with needs("formats", "XDF"):
        import pyxdf

    content = source.read_bytes()
    end = _whole(content)
    notes = []
    if end < len(content):
        notes.append(
            f"the file ends within a chunk: {len(content) - end} of {len(content)} bytes are lost"
        )
    kept = BufferingHandler(MAX_SAID)
    kept.setLevel(logging.ERROR)
    logger = logging.getLogger("pyxdf")
    logger.addHandler(kept)
    try:
        streams, _ = pyxdf.load_xdf(BytesIO(content[:end]))
    finally:
        logger.removeHandler(kept)
    notes += [f"pyxdf says: {record.getMessage().strip()}" for record in kept.buffer]
    columns: dict[str, Column] = {}
    names = [stream["info"]["name"][0] or "stream" for stream in streams]
    for name, stream in zip(names, streams, strict=True):
        if names.count(name) > 1:
            name = f"{name}#{stream['info']['stream_id']}"
        values, time_s = stream["time_series"], stream["time_stamps"]
        if not isinstance(values, np.ndarray) or not len(values):
            notes.append(f"stream {name!r} has no numbers and is left out")
            continue
        if stream.get("footer") is None:
            notes.append(f"stream {name!r} was not finished; what is whole is read")
        labels, units = _channels(stream["info"], values.shape[1])
        values = values.astype(np.float64)
        for n, label in enumerate(labels):
            columns[f"{name}/{label}"] = Column(values[:, n], time_s, units[n])
        if len(labels) > 1:
            columns[name] = Column(values, time_s, units[0] if len(set(units)) == 1 else "")
    return Recording(columns, tuple(notes))


def _whole(content: bytes) -> int:
    """Where the last whole chunk ends, by the published layout; raises `CsvError` without one."""
    if not content.startswith(b"XDF:"):
        raise CsvError("is no XDF file: it does not begin with XDF:")
    at = 4
    while at < len(content):
        width = content[at]
        if width not in LENGTHS or at + 1 + width > len(content):
            break
        (length,) = struct.unpack_from(LENGTHS[width], content, at + 1)
        if (end := at + 1 + width + length) > len(content):
            return at
        at = end
    return at if at >= len(content) or content[at] in LENGTHS else len(content)


def _channels(info: Any, count: int) -> tuple[list[str], list[str]]:
    """Labels and units; numbers where the stream does not say them all."""
    try:
        channels = info["desc"][0]["channels"][0]["channel"]
        labels = [channel["label"][0] for channel in channels]
    except (KeyError, TypeError, IndexError):
        channels, labels = [], []
    if len(labels) != count or len(set(labels)) != count or not all(labels):
        return [str(n) for n in range(count)], [""] * count
    return labels, [(channel.get("unit") or [""])[0] or "" for channel in channels]
