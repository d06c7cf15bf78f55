"""Runs for other programs: the numbers and their units arrive."""

import csv
import errno
import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from mcap.reader import make_reader

from drivers import Block, Channel
from probe.config.rig import Rig
from probe.core.events import Finish, RunEnded, RunStarted, Samples
from probe.detection import detect
from probe.scan.session import scan
from probe.storage.export import WRITERS, export
from probe.storage.run import Run, RunFileError, open_run
from probe.storage.writer import create_store


def test_csv(path: Path, tmp_path: Path) -> None:
    written = {p.name.removeprefix(f"{path.stem}-"): p for p in export(path, ["csv"], tmp_path)}
    assert set(written) == {
        "stations.csv",
        "config.json",
        "force-simulated.csv",
        "stage-simulated.csv",
    }
    data = open_run(path).samples()
    with written["force-simulated.csv"].open(newline="") as file:
        rows = list(csv.DictReader(file))  # to the bit: pandas 2 reads numbers less exactly
    assert list(rows[0])[:5] == ["time_s", "station", "attempt", "phase", "force_N"]
    assert [float(row["force_N"]) for row in rows] == data["force"].values.tolist()
    assert [float(row["time_s"]) for row in rows] == data["time_s"].values.tolist()
    assert {(row["x_mm"], row["y_mm"]) for row in rows if row["x_mm"]} == {
        ("28.0", "0.0"), ("32.0", "0.0"),
    }  # fmt: skip
    assert pd.read_csv(written["stations.csv"])["x_mm"].to_list() == pytest.approx([28, 32])
    about = json.loads(written["config.json"].read_text())
    assert about["seed"] == 4
    assert "force.force" in about["simulated"]


def test_hdf5(path: Path, tmp_path: Path) -> None:
    (written,) = export(path, ["hdf5"], tmp_path)
    data = open_run(path).samples()
    with h5py.File(written) as file:
        assert file["force/force"].attrs["units"] == "N"
        assert file["force/force"].attrs["simulated"] == 1
        assert file["stage/z"].attrs["units"] == "m"
        assert file["stations/x_mm"].attrs["units"] == "mm"
        assert (file["force/force"][:] == data["force"].values).all()
        assert "holding" in file["force/phase"].asstr()[:]
        assert json.loads(file["config"].asstr()[()])["rig"]["scan"]["stations"] == 2
        assert "stage.z" in file.attrs["simulated"]


def test_netcdf(path: Path, tmp_path: Path) -> None:
    (written,) = export(path, ["netcdf"], tmp_path)
    data = open_run(path).samples()
    with xr.open_dataset(written, group="force", engine="h5netcdf") as found:
        assert found["force"].attrs["units"] == "N"
        np.testing.assert_array_equal(found["force"], data["force"])
        np.testing.assert_array_equal(found["phase"], data["phase"])
        assert found["force_saturated"].dtype == bool
    with xr.open_dataset(written, engine="h5netcdf") as found:
        assert found["x_mm"].attrs["units"] == "mm"
        assert found["complete"].values.all()
        assert json.loads(found.attrs["config"])["seed"] == 4


def test_again_replaces(path: Path, tmp_path: Path) -> None:
    first = export(path, ["csv", "hdf5", "netcdf"], tmp_path)
    assert export(path, "csv, hdf5,netcdf", tmp_path) == first, "as the shell has them"


def test_wrong_formats_and_runs_are_named(path: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'matlab': known are csv, hdf5, netcdf"):
        export(path, ["csv", "matlab"], tmp_path / "out")
    assert not (tmp_path / "out").exists()
    with pytest.raises(ValueError, match="formats is empty: name one or several of csv"):
        export(path, [], tmp_path / "out")
    with pytest.raises(RunFileError):
        export(tmp_path / "missing.run", ["csv"], tmp_path)


@pytest.mark.parametrize("full", [
    OSError(errno.ENOSPC, "No space left on device"),
    RuntimeError("flush failed (errno = 28, error message = 'No space left on device')"),
])  # fmt: skip
def test_half_an_export_is_not_left_and_an_earlier_one_stays(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, full: Exception
) -> None:
    def break_off(_run: Run, folder: Path) -> list[Path]:
        (folder / f"{path.stem}.nc").write_bytes(b"half")
        raise full

    (whole,) = export(path, ["netcdf"], tmp_path)
    before = whole.read_bytes()
    monkeypatch.setitem(WRITERS, "netcdf", break_off)
    with pytest.raises(OSError, match="No space left on device") as refused:
        export(path, "csv,netcdf,csv", tmp_path)
    assert refused.value.filename == str(tmp_path)
    assert (list(tmp_path.iterdir()), whole.read_bytes()) == ([whole], before)


@pytest.mark.parametrize("fmt", ["csv", "parquet", "hdf5", "netcdf", "mcap"])
def test_devices_whose_names_differ_in_special_characters_only_all_arrive(
    tmp_path: Path, fmt: str
) -> None:
    levels = {"cell 1": 1.0, "cell_1": 2.0, "cell/1": 3.0, "Cell_1": 4.0, "stations": 5.0}
    channels = {name: (Channel("force", "N", "force"),) for name in levels}
    with create_store(tmp_path / "many.run") as sink:
        sink(RunStarted(0.0, "2026-01-01T00:00:00+00:00", {}, channels))
        for name, value in levels.items():
            block = Block(np.array([1.0]), np.array([[value]]), np.zeros((1, 1), bool), 0)
            sink(Samples(name, block, None, None))
        sink(RunEnded(2.0, Finish.COMPLETED, "all there"))
    files = export(tmp_path / "many.run", [fmt], tmp_path / "out")
    assert len({file.name.lower() for file in files}) == len(files)
    readers = {"csv": of_csv, "parquet": of_parquet, "hdf5": of_groups, "netcdf": of_groups,
               "mcap": of_mcap}  # fmt: skip
    found = sorted(value for file in files for value in readers[fmt](file))
    assert found == [1.0, 2.0, 3.0, 4.0, 5.0]


def of_csv(file: Path) -> list[float]:
    table = pd.read_csv(file) if file.suffix == ".csv" else pd.DataFrame()
    return list(table.get("force_N", []))


def of_parquet(file: Path) -> list[float]:
    return list(pd.read_parquet(file).get("force_N", []))


def of_groups(file: Path) -> list[float]:
    with h5py.File(file) as kept:
        groups = [group for group in kept.values() if isinstance(group, h5py.Group)]
        return [v for group in groups for v in group.get("force", [])]


def of_mcap(file: Path) -> list[float]:
    with file.open("rb") as stream:
        read = list(make_reader(stream).iter_messages())
    topics = {channel.topic for _, channel, _ in read if channel.topic.endswith("/sample")}
    schemas = {schema.name for schema, channel, _ in read if channel.topic.endswith("/sample")}
    assert len(topics) == len(schemas) == 5
    kept = [m.data for _, channel, m in read if channel.topic.endswith("/sample")]
    return [struct.unpack_from("<d", data, len(data) - 9)[0] for data in kept]


def test_the_table_of_stations_says_what_detection_says(tmp_path: Path, winkler: Any) -> None:
    """In every format; a pulse that is not seen has none, and what it is below."""
    rig = Rig.model_validate({"scan": {"start_mm": 28, "stations": 3}})
    path = scan(rig, "TIHA", tmp_path, seed=1, respond=winkler).path
    found = detect(path)
    one = found.stations[1]
    unseen = replace(one, pulse_below_pa=8.0, note="why")
    found = replace(found, stations=(found.stations[0], unseen, found.stations[2]))
    made = export(path, list(WRITERS), tmp_path / "out", found)
    (table,) = [file for file in made if file.name.endswith("-stations.csv")]
    rows = pd.read_csv(table, keep_default_na=False, na_values=[""])
    assert rows["level_pa"].tolist() == pytest.approx([s.baseline_pa for s in found.stations])
    first, second = rows.iloc[0], rows.iloc[1]
    reach_pa = 1.96 * found.stations[0].pulse_sd_pa
    assert first.pulse_high_pa - first.pulse_pa == pytest.approx(reach_pa)
    assert np.isnan(second.pulse_pa)
    assert (second.pulse_low_pa, second.pulse_high_pa, second.note) == (0.0, 8.0, "why")
    assert "level_pa" not in open_run(path).stations()
