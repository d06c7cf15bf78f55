"""A run of one press that lasts a second, of any channels, on a face of 25 mm2."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drivers import Block, Channel
from probe.core.events import Finish, RunEnded, RunStarted, Samples, StationEnded, StationStarted
from probe.storage.writer import create_store

Devices = Mapping[str, tuple[Channel, ...]]


def pressed(device: str, time_s: Any, values: Any, saturated: Any = False) -> Samples:
    """Samples of the press; ``values`` and ``saturated`` broadcast to (times, channels)."""
    values = np.reshape(values, (len(time_s), -1)).astype(float)
    marks = np.zeros(values.shape, bool) | saturated
    return Samples(device, Block(np.asarray(time_s, float), values, marks), 0, 1)


def one_press(path: Path, channels: Devices, samples: Iterable[Samples]) -> Path:
    """Written to ``path``."""
    config = {"face_mm2": 25.0, "plan": {"stations": [[0, 5.0, None]], "columns": ["index"]}}
    with create_store(path) as store:
        store(RunStarted(0.0, "2026-01-02T03:04:05+00:00", config, channels))
        store(StationStarted(0.0, 0, 1, 5e-3, math.nan))
        for block in samples:
            store(block)
        store(StationEnded(1.0, 0, 1, complete=True))
        store(RunEnded(1.0, Finish.COMPLETED, ""))
    return path
