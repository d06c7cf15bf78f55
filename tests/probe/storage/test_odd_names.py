"""Nothing is lost on the way out of a run, whatever its channels are and are called."""

import os
import sys
from collections.abc import Mapping
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from mcap.reader import make_reader
from pyarrow import parquet
from ros_messages import ros_messages

from drivers import Block, Channel
from drivers.core.arrays import Array
from probe.core.events import (
    Event,
    Finish,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.storage.csv_import import import_csv
from probe.storage.export import export
from probe.storage.run import open_run
from probe.storage.writer import create_store, reopen_store

FORCE = Channel("force", "N", "force")
BEGAN = datetime.fromisoformat("2026-01-01T00:00:00+00:00")
FORMS = ["csv", "parquet", "hdf5", "netcdf", "mcap"]
Devices = Mapping[str, tuple[Channel, ...]]


def session(channels: Devices, began_s: float, later_s: float, station: int) -> list[Event]:
    """One station; channel n of device d reads 100 d + n + 0.1, 0.2, …"""
    time_s = began_s + 0.01 * np.arange(1, 21)
    plan = {"stations": [[n, 4.0 * n, None] for n in range(3)]}
    samples = [
        Samples(device, Block(time_s, values, np.zeros(values.shape, bool)), station, 1)
        for d, (device, own) in enumerate(channels.items())
        for values in [100.0 * d + np.arange(len(own)) + 0.1 * np.arange(1, 21)[:, None]]
    ]
    wall = (BEGAN + timedelta(seconds=later_s)).isoformat()
    return [
        RunStarted(began_s, wall, {"plan": plan, "face_mm2": 100.0}, channels),
        StationStarted(began_s, station, 1, 4e-3 * station, np.nan),
        *samples,
        StationEnded(began_s + 0.3, station, 1, complete=True),
        RunEnded(began_s + 0.3, Finish.ABORTED, "stopped"),
    ]


def run_of(path: Path, channels: Devices) -> Path:
    with create_store(path) as store:
        for event in session(channels, 0.0, 0.0, 1):
            store(event)
    return path


def first_of(d: int, n: int) -> Array:
    return 100.0 * d + n + 0.1 * np.arange(1, 21)


ODD = tuple(
    Channel(name, unit)
    for name, unit in [
        ("station", "V"), ("phase", "V"), ("time_s", ""), ("x", "mm"), ("Fx", "N"), ("fx", "N"),
        ("fx", "N"), ("a/b", "V"), ("", "V"), ("kraft_µ", "N"), ("fx_saturated", ""), ("ß", "V"),
    ]
)  # fmt: skip


def test_channels_with_names_that_are_taken_are_all_in_every_table(tmp_path: Path) -> None:
    path = run_of(tmp_path / "a.run", {"zelle ü": (*ODD, FORCE)})
    data = open_run(path).samples()
    assert set(data["station"].values) == {2}
    assert set(data["phase"].values) == {"idle"}
    reported = [str(name) for name, one in data.data_vars.items() if "role" in one.attrs]
    for n, name in enumerate(reported):
        assert np.array_equal(data[name], first_of(0, n))
    assert len(reported) == len(ODD) + 1
    files = dict(zip(FORMS, (export(path, [f], tmp_path / "out") for f in FORMS), strict=True))
    flat = pd.read_csv(files["csv"][2])
    assert np.array_equal(flat["x_mm_2"], first_of(0, 3))
    assert set(flat["x_mm"]) == {4.0}
    units = {f.name: (f.metadata or {}).get(b"units") for f in parquet.read_schema(
        files["parquet"][1])}  # fmt: skip
    assert units["station_2_V"] == b"V"
    assert units["x_mm_2"] == units["x_mm"] == b"mm"
    with xr.open_dataset(files["netcdf"][0], group="zelle_ü", engine="h5netcdf") as found:
        for n, name in enumerate(reported):
            assert np.array_equal(found[name], first_of(0, n))
    messages = ros_messages(files["mcap"][0], "/sample")
    names = [k for k in vars(messages[0]) if k in telling(messages[0])]
    assert len(names) == len(ODD) + 1
    for n, name in enumerate(names):
        assert [getattr(m, name) for m in messages] == first_of(0, n).tolist()


def telling(message: object) -> list[str]:
    """The message's fields that hold a channel."""
    others = {"header", "time_s", "station", "attempt", "phase"}
    return [k for k, v in vars(message).items() if isinstance(v, float) and k not in others]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names are always text")
@pytest.mark.parametrize("form", FORMS)
def test_a_folder_may_have_a_name_that_is_not_utf_8(form: str, tmp_path: Path) -> None:
    path = run_of(tmp_path / "a.run", {"cell": (FORCE,)})
    folder = tmp_path / os.fsdecode(b"f\xff")
    (samples,) = [
        file for file in export(path, [form], folder)
        if form in ("hdf5", "netcdf", "mcap") or file.stem.endswith("cell")
    ]  # fmt: skip
    back = open_run(import_csv(samples, tmp_path / "b.run", face_mm2=100.0).path)
    assert np.array_equal(back.samples()["force"], first_of(0, 0))


@pytest.mark.parametrize("form", FORMS)
def test_a_run_without_a_force_is_exported(form: str, tmp_path: Path) -> None:
    path = run_of(tmp_path / "a.run", {"ecg": (Channel("ecg", "mV", "reference"),)})
    assert export(path, [form], tmp_path / "out")
    assert open_run(path).stations()["samples"].tolist() == [0]


def test_each_session_of_a_resumed_run_has_its_own_wall_time(tmp_path: Path) -> None:
    path = run_of(tmp_path / "a.run", {"cell": (FORCE,)})
    with reopen_store(path) as store:
        for event in session({"cell": (FORCE,)}, 5.0, 3600.0, 2):
            store(event)
    (file,) = export(path, ["mcap"], tmp_path)
    with file.open("rb") as stream:
        times = [m.log_time for _, _, m in make_reader(stream).iter_messages(["/cell/sample"])]
    began = int(BEGAN.timestamp()) * 10**9
    assert times[0] == began + 10_000_000
    assert times[20] == began + 3600 * 10**9 + 10_000_000


def test_no_session_begins_before_the_last_has_ended(tmp_path: Path) -> None:
    """A simulated scan's clock is ahead of the day's: here it is resumed after 1 s of 5."""
    path = run_of(tmp_path / "a.run", {"cell": (FORCE,)})
    with reopen_store(path) as store:
        for event in session({"cell": (FORCE,)}, 5.0, 1.0, 2):
            store(event)
    (file,) = export(path, ["mcap"], tmp_path)
    back = open_run(import_csv(file, tmp_path / "b.run", face_mm2=100.0).path)
    assert np.array_equal(back.samples()["time_s"], open_run(path).samples()["time_s"])
    assert back.stations()["x_mm"].tolist() == [4.0, 8.0]


def test_a_session_does_not_begin_in_the_phase_that_the_last_was_killed_in(tmp_path: Path) -> None:
    channels = {"cell": (FORCE,)}
    first, second = session(channels, 0.0, 0.0, 1), session(channels, 5.0, 60.0, 2)
    killed = [*first[:2], PhaseEntered(0.0, Phase.HOLDING, 1), *first[2:-2]]
    with create_store(tmp_path / "a.run") as store:
        for event in [*killed, *second]:
            store(event)
    phases = open_run(tmp_path / "a.run").samples()["phase"].values.tolist()
    assert phases == ["holding"] * 20 + ["idle"] * 20


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("places", ["", ",x_mm"])
def test_an_imported_recording_comes_back_with_what_it_had(
    form: str, places: str, tmp_path: Path
) -> None:
    rows = [f"{n / 100:g},{n % 7},{1 + n // 10}" for n in range(30)]
    if places:
        rows = [f"{row},{4 * (n // 10)}" for n, row in enumerate(rows)]
    (tmp_path / "a.csv").write_text("\n".join([f"time_s,force_n,station{places}", *rows]))
    first = open_run(import_csv(tmp_path / "a.csv", tmp_path / "a.run", face_mm2=50.0).path)
    files = export(first, [form], tmp_path / "out")
    (file,) = (f for f in files if len(files) == 1 or "-imported" in f.name)
    again = open_run(import_csv(file, tmp_path / "b.run", face_mm2=50.0).path)
    pd.testing.assert_frame_equal(again.stations(), first.stations())
    xr.testing.assert_equal(again.samples(), first.samples())
