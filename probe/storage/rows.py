"""One event as one row of the run file, and back.

A row is ``kind``, ``body`` (JSON: every field but the arrays) and, for samples, the arrays as
little-endian bytes: ``times`` (n,) and ``readings`` (n, channels) float64, ``saturated``
(n, channels) one byte each. ``sha256`` is over the row alone; ``chain`` is over the chain of the
row before and this ``sha256``, so that no row can be lost or change its place unseen.
"""

import json
import math
from dataclasses import asdict, dataclass
from hashlib import sha256
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from pydantic_core import from_json

from drivers import Block
from probe.core.errors import RunFileError
from probe.core.events import (
    Event,
    Note,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)

FIRST = bytes(32)  # what the first row's chain begins with
FLOAT, FLAG = np.dtype("<f8"), np.dtype("u1")
BLOCK_BYTES = 450
"""Of a block of samples beside those: 226 to 435 of files with 2 to 25 samples a block, of 1 to 256
channels."""
# 4096 taxels at 1 kHz, 0.2 s a block: 7 MB; a plan of 100,000 presses with its surface: 8 MB.
MAX_ROW_BYTES = 16 * 1024**2
MAX_CHANNELS = 4096
# What JSON takes in memory once read, at most: by object, array and comma (CPython 3.11, 64 bit).
MAX_PARSED_BYTES = 64 * 1024**2
PARSED_BYTES = {"{": 240, "[": 72, ",": 72}

_KINDS: dict[str, type[Any]] = {
    "run_started": RunStarted,
    "station_started": StationStarted,
    "phase_entered": PhaseEntered,
    "station_ended": StationEnded,
    "note": Note,
    "run_ended": RunEnded,
}
_NAMES = {kind: name for name, kind in _KINDS.items()}
SAMPLES = "samples"
_Count = Annotated[int, Field(strict=True, ge=0, lt=2**31)]


@dataclass(frozen=True)
class _Block:
    """The body of a block of samples, beside its arrays: ``shape`` is (n, channels)."""

    device: str
    station: _Count | None
    attempt: _Count | None
    shape: tuple[_Count, Annotated[_Count, Field(le=MAX_CHANNELS)]]
    dtype: Literal["<f8"]
    lost: _Count


_ADAPTERS = {name: TypeAdapter[Any](kind) for name, kind in (_KINDS | {SAMPLES: _Block}).items()}


class Row(NamedTuple):
    """The columns that are stored; ``id`` and ``chain`` come from the place in the file."""

    kind: str
    body: str
    times: bytes | None
    readings: bytes | None
    saturated: bytes | None

    @property
    def sha256(self) -> bytes:
        """The checksum of the row alone.

        Each part is length-prefixed, so that bytes cannot move between parts unseen.
        """
        digest = sha256()
        for part in (self.kind.encode(), self.body.encode(), *self[2:]):
            digest.update(b"-" if part is None else b"%d:" % len(part))
            digest.update(part or b"")
        return digest.digest()


def link(chain: bytes, digest: bytes) -> bytes:
    """The next value of the chain."""
    return sha256(chain + digest).digest()


def to_row(event: Event) -> Row:
    """Raises `ValueError` for a number that is none, or a config that is not JSON."""
    if isinstance(event, Samples):
        return _samples_to_row(event)
    fields = asdict(event)
    if isinstance(event, StationStarted):  # an imported recording may know no position
        for key in ("x_m", "y_m"):
            fields[key] = None if math.isnan(fields[key]) else fields[key]
    return Row(_NAMES[type(event)], _json(fields), None, None, None)


def from_row(row: Row) -> Event:
    """Raises `RunFileError` for anything `to_row` would not have written."""
    if not (isinstance(row.kind, str) and isinstance(row.body, str)):
        raise RunFileError("an event is not text")
    if row.kind not in _ADAPTERS:
        raise RunFileError(f"unknown kind of event {row.kind[:40]!r}")
    body = _loads(row.body)
    if row.kind == "station_started":
        for key in ("x_m", "y_m"):
            body[key] = math.nan if body.get(key) is None else body[key]
    try:
        event: Event | _Block = _ADAPTERS[row.kind].validate_python(body)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise RunFileError(f"a {row.kind} event's {where}: {first['msg']}") from None
    return _with_arrays(event, row) if isinstance(event, _Block) else event


def bytes_per_s(rate_hz: float, channels: int, blocks_hz: float) -> float:
    """What a run file grows by while a device of so many channels is read, in so many blocks."""
    sample = FLOAT.itemsize + channels * (FLOAT.itemsize + FLAG.itemsize)
    return rate_hz * sample + blocks_hz * BLOCK_BYTES


def _samples_to_row(event: Samples) -> Row:
    block = event.block
    n, channels = block.values.shape
    body = {
        "device": event.device,
        "station": event.station,
        "attempt": event.attempt,
        "time_s": float(block.time_s[-1]) if n else None,
        "shape": [n, channels],
        "dtype": FLOAT.str,
        "lost": block.lost,
    }
    return Row(
        SAMPLES,
        _json(body),
        np.ascontiguousarray(block.time_s, FLOAT).tobytes(),
        np.ascontiguousarray(block.values, FLOAT).tobytes(),
        np.ascontiguousarray(block.saturated, FLAG).tobytes(),
    )


def _with_arrays(body: _Block, row: Row) -> Samples:
    (n, channels), station, attempt = body.shape, body.station, body.attempt
    if (station is None) != (attempt is None):
        raise RunFileError(f"a block of samples of station {station}, attempt {attempt}")
    wanted = (8 * n, 8 * n * channels, n * channels)
    for part, size in zip((row.times, row.readings, row.saturated), wanted, strict=True):
        if not isinstance(part, bytes) or len(part) != size:
            raise RunFileError(f"a block of samples is not of its shape {n} x {channels}")
    assert row.times is not None and row.readings is not None and row.saturated is not None
    return Samples(
        body.device,
        Block(
            np.frombuffer(row.times, FLOAT).astype(np.float64),
            np.frombuffer(row.readings, FLOAT).astype(np.float64).reshape(n, channels),
            np.frombuffer(row.saturated, FLAG).astype(bool).reshape(n, channels),
            body.lost,
        ),
        station,
        attempt,
    )


def _json(body: dict[str, Any]) -> str:
    text = json.dumps(body, allow_nan=False, separators=(",", ":"), ensure_ascii=False)
    _check_size(text)
    return text


def _check_size(body: str) -> None:
    if len(body) > MAX_ROW_BYTES:
        raise RunFileError(f"an event of {len(body)} characters is too large")
    if sum(size * body.count(part) for part, size in PARSED_BYTES.items()) > MAX_PARSED_BYTES:
        raise RunFileError("an event holds too many values")


def _loads(body: str) -> dict[str, Any]:
    _check_size(body)
    try:
        loaded = from_json(body, allow_inf_nan=False)  # refuses deep nesting, unlike json
    except ValueError as error:
        raise RunFileError(f"an event is not JSON ({error})") from None
    if not isinstance(loaded, dict):
        raise RunFileError("an event is not a JSON object")
    return loaded
