"""What does not fit the memory is kept in files, and nobody can tell."""

from pathlib import Path

import numpy as np
import pytest

from probe.acquisition.session import scan
from probe.core import spill
from probe.core.spill import Spill
from probe.storage.run import open_run
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
    run = open_run(scan(None, "TI", tmp_path, respond=winkler).path)
    whole = run.recording()
    monkeypatch.setattr(spill, "IN_MEMORY", 0)
    spilt = run.recording()
    for one, other in zip(whole.stations, spilt.stations, strict=True):
        for name in ("time_s", "signal_pa", "saturated", "depth_m"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
