"""A run of one station, written block by block as a scan does."""

from pathlib import Path

import numpy as np

from drivers import Block, Channel
from probe.core.events import RunStarted, Samples, StationStarted
from probe.storage.writer import Store, create_store

CHANNELS = {"cell": (Channel("force", "N", "force", simulated=True),)}
STARTED = RunStarted(
    0.0, "2026-01-01T00:00:00+00:00", {"plan": {"stations": [[0, 1, 0]]}}, CHANNELS
)


def samples(n: int) -> Samples:
    """The block number ``n``, of 25 readings in 50 ms."""
    time_s = 0.05 * n + 2e-3 * np.arange(1, 26)
    values = np.sin(time_s)[:, None]
    return Samples("cell", Block(time_s, values, values > 2), 0, 1)


def written(path: Path, blocks: int) -> Store:
    """Events, one commit each; the last stay in the log."""
    store = create_store(path)
    store(STARTED)
    store(StationStarted(0.0, 0, 1, 1e-3, 0.0))
    for n in range(blocks):
        store(samples(n))
        store.flush()
    return store


def log(path: Path) -> Path:
    """Of a run."""
    return path.with_name(path.name + "-wal")
