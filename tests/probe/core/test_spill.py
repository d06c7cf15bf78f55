"""What does not fit the memory is kept in files, and nobody can tell."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from paths import ROOT

from drivers import Block, Channel
from probe.config.rig import Rig
from probe.core import cut_stations, spill
from probe.core.events import Finish, RunEnded, RunStarted, Samples, StationEnded, StationStarted
from probe.core.spill import Growing, Spill
from probe.scan.session import scan
from probe.storage.run import open_run
from probe.storage.writer import create_store
from sim_backend.phantom.phantom import Respond


def test_an_array_is_the_same_in_memory_and_in_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spill, "IN_MEMORY", 100)
    monkeypatch.setattr(spill, "FILE", 4096)
    kept, rng = Spill(), np.random.default_rng(0)
    arrays = [
        np.arange(10.0), np.empty(0), np.empty((0, 3)), rng.uniform(size=(7, 3)),
        rng.uniform(size=(300, 2)) > 0.5, rng.uniform(size=5000), np.array([np.nan]),
    ]  # fmt: skip
    found = [kept.keep(array) for array in arrays]
    assert found[0] is arrays[0]  # the first has room
    for one, array in zip(found, arrays, strict=True):
        assert (one.dtype, one.shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(one, array)
    assert found[5].base is not None
    with pytest.raises(ValueError, match="read-only"):
        found[5][0] = 1.0


def test_a_recording_is_the_same_out_of_files(
    winkler: Respond, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig.model_validate({"scan": {"start_mm": 28, "stations": 3}})
    run = open_run(scan(rig, "TI", tmp_path, respond=winkler).path)
    whole = run.recording()
    monkeypatch.setattr(spill, "IN_MEMORY", 0)
    monkeypatch.setattr(spill, "ONE", 0)
    monkeypatch.setattr(cut_stations, "PART", 100)
    spilt = run.recording()
    for one, other in zip(whole.stations, spilt.stations, strict=True):
        for name in ("time_s", "signal_pa", "saturated", "depth_m"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert whole.quantum_pa == spilt.quantum_pa


def test_what_grows_is_the_same_in_memory_and_in_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    rows = [rng.uniform(size=(n, 3)) for n in (0, 7, 1, 900, 0, 2)]
    for one in (10**6, 400):
        monkeypatch.setattr(spill, "ONE", one)
        growing = Growing(np.float64, 3)
        for part in rows:
            growing.add(part)
        whole = growing.whole()
        assert (whole.base is not None, whole.flags.writeable) == (True, one > 400)
        growing.rest()
        np.testing.assert_array_equal(whole, np.concatenate(rows))
    kept = Spill()
    assert kept.keep(whole) is whole  # it is in a file already


def test_a_press_that_is_broken_off_leaves_no_file_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spill, "ONE", 0)
    growing = Growing(np.bool_)
    growing.add(np.ones(5, bool))
    file = growing._file
    assert file is not None
    del growing
    assert file.closed


PEAK = """
import re, sys
from pathlib import Path
from probe.storage.run import open_run

def peak_mb():
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\\s*([0-9]+)", status)[1]) / 1024

open_run(sys.argv[1]).started
first = peak_mb()
recording = open_run(sys.argv[1]).recording()
print(peak_mb() - first, recording.stations[0].signal_pa.nbytes / 1e6)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "poses", "held_at_least_mb"), [(64, 0, 150), (1, 20_000, 2)])
def test_a_long_press_is_read_in_little_memory(
    tmp_path: Path, columns: int, poses: int, held_at_least_mb: float
) -> None:
    """All in one press: so many channels or poses that they make 100 MB, of which nothing stays."""
    path = tmp_path / "long.run"
    taxels = tuple(Channel(f"t{n}", "Pa", "pressure") for n in range(columns))
    stage = tuple(Channel(axis, "m", "position") for axis in "xyz")
    rng = np.random.default_rng(0)
    with create_store(path) as store:
        start = "2026-01-01T00:00:00+00:00"
        store(RunStarted(0.0, start, {}, {"taxels": taxels, "stage": stage}))
        store(StationStarted(0.0, 0, 1, 0.0, 0.0))
        for n in range(300):
            for device, count, wide in (("taxels", 1000, columns), ("stage", poses, 3)):
                values, times = rng.normal(size=(count, wide)), n + np.arange(1, count + 1) / count
                block = Block(times, values, np.zeros((count, wide), bool))
                store(Samples(device, block, 0, 1))
            if n % 10 == 0:
                store.flush()
        store(StationEnded(301.0, 0, 1, complete=True))
        store(RunEnded(301.0, Finish.COMPLETED, "every station is complete"))
    done = subprocess.run(
        [sys.executable, "-c", PEAK, path], capture_output=True, text=True, check=True, cwd=ROOT
    )
    more_mb, held_mb = map(float, done.stdout.split())
    assert held_mb > held_at_least_mb
    assert more_mb < 80, f"{more_mb:.0f} MB"
