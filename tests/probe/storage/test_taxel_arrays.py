"""An array is an array wherever a run goes: element (r, c) is in row r and column c."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from one_press import one_press, pressed
from scipy.io import loadmat

from drivers import Channel
from drivers.core.array_layout import taxel_names
from drivers.core.arrays import Array
from probe.storage.csv_import import CsvError, import_csv
from probe.storage.export import export
from probe.storage.run import open_run

LAYOUTS = [(1, 8), (4, 7), (8, 8), (16, 16)]
SAMPLES = 12


def run_of(folder: Path, channels: tuple[Channel, ...], values: Array) -> Path:
    """A run of one press, whose samples all read ``values`` (channels,) and 0.5 more each time."""
    block = values + 0.5 * np.arange(SAMPLES)[:, None]
    clipped = np.zeros(block.shape, bool)
    clipped[3, -1] = True
    samples = pressed("skin", 0.02 * np.arange(1, SAMPLES + 1), block, clipped)
    return one_press(folder / "a.run", {"skin": channels}, [samples])


def skin(rows: int, columns: int) -> tuple[Channel, ...]:
    return tuple(Channel(name, "Pa", "taxel") for name in taxel_names(rows, columns))


def numbered(rows: int, columns: int) -> Array:
    """100 times the row, and the column."""
    return np.add.outer(100.0 * np.arange(rows), np.arange(columns))


def _hdf5(run: Path) -> Array:
    (path,) = export(run, "hdf5", run.parent / "out")
    with h5py.File(path) as file:
        assert file["skin/taxels"].attrs["units"] == "Pa"
        return np.asarray(file["skin/taxels"][:])


def _netcdf(run: Path) -> Array:
    (path,) = export(run, "netcdf", run.parent / "out")
    with xr.open_dataset(path, group="skin") as data:
        assert data["taxels"].dims == ("time_s", "row", "column")
        return data["taxels"].to_numpy()


def _mat(run: Path) -> Array:
    (path,) = export(run, "mat", run.parent / "out")
    found = loadmat(path, simplify_cells=True)["skin"]
    assert found["units"]["taxels"] == "Pa"
    taxels = np.asarray(found["taxels"])
    return taxels.reshape(SAMPLES, -1, taxels.shape[-1])  # one row is squeezed


def _lerobot(run: Path) -> Array:
    (folder,) = export(run, "lerobot", run.parent / "out")
    frames = pd.read_parquet(folder / "data/chunk-000/file-000.parquet")
    each = frames["observation.tactile.skin"]
    return np.array([np.stack(list(frame)) for frame in each])


def _table(run: Path, kind: str, read: Callable[[Path], pd.DataFrame]) -> Array:
    files = export(run, kind, run.parent / "out")
    (path,) = (file for file in files if "-skin" in file.name)
    table = read(path)
    places = [name for name in table if str(name).endswith("_Pa")]
    rows = 1 + max(int(str(name)[1:].partition("c")[0]) for name in places)
    return table[places].to_numpy().reshape(SAMPLES, rows, -1)


READERS: dict[str, Callable[[Path], Array]] = {
    "samples": lambda run: open_run(run).samples()["taxels"].to_numpy(),
    "hdf5": _hdf5,
    "netcdf": _netcdf,
    "mat": _mat,
    "lerobot": _lerobot,
    "csv": lambda run: _table(run, "csv", pd.read_csv),
    "parquet": lambda run: _table(run, "parquet", pd.read_parquet),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(("rows", "columns"), LAYOUTS, ids=str)
def test_each_element_is_in_its_row_and_column(
    rows: int, columns: int, reader: str, tmp_path: Path
) -> None:
    wanted = numbered(rows, columns)
    run = run_of(tmp_path, skin(rows, columns), wanted.ravel())
    found = READERS[reader](run)
    assert found.shape == (SAMPLES, rows, columns)
    np.testing.assert_allclose(found[0], wanted)
    np.testing.assert_allclose(found[-1], wanted + 0.5 * (SAMPLES - 1))


def test_what_clipped_is_marked_in_its_place(tmp_path: Path) -> None:
    data = open_run(run_of(tmp_path, skin(4, 7), np.zeros(28))).samples()
    assert np.argwhere(data["taxels_saturated"].to_numpy()).tolist() == [[3, 3, 6]]
    (path,) = export(tmp_path / "a.run", "mat", tmp_path)
    assert loadmat(path)["skin"]["taxels_saturated"][0, 0].nonzero() == (3, 3, 6)


def test_changed_arrays_are_judged_in_place_of_what_was_stored(tmp_path: Path) -> None:
    run = open_run(run_of(tmp_path, skin(2, 3), np.arange(6.0)))
    changed = run.samples()
    changed["taxels"] *= 2.0
    for samples in (changed, run.channel_samples().to_dataframe() * 1):
        (judged,) = run.recording(samples=samples).stations
        (stored,) = run.recording().stations
        factor = 2.0 if samples is changed else 1.0
        np.testing.assert_allclose(judged.signal_pa, factor * stored.signal_pa)


def test_a_taxel_that_is_none_any_more_leaves_a_hole(tmp_path: Path) -> None:
    channels = list(skin(2, 3))
    channels[4] = replace(channels[4], role="other", unit="")
    data = open_run(run_of(tmp_path, tuple(channels), np.arange(6.0))).samples()
    np.testing.assert_equal(data["taxels"].to_numpy()[0], [[0, 1, 2], [3, np.nan, 5]])
    assert data["r1c1"].to_numpy()[0] == 4.0


@pytest.mark.parametrize("channels", [
    tuple(Channel(f"t{n}", "Pa", "taxel") for n in range(6)),
    (*skin(1, 5), Channel("r0c4", "Pa", "taxel")),
    (*skin(1, 5), Channel("r0c5", "kPa", "taxel")),
], ids=["no names", "twice the same", "another unit"])  # fmt: skip
def test_taxels_whose_places_nobody_knows_stay_channels(
    channels: tuple[Channel, ...], tmp_path: Path
) -> None:
    data = open_run(run_of(tmp_path, channels, np.arange(6.0))).samples()
    assert "taxels" not in data
    assert sum(one.attrs.get("role") == "taxel" for one in data.data_vars.values()) == 6


def test_a_damaged_array_is_refused_and_named(tmp_path: Path) -> None:
    (path,) = export(run_of(tmp_path, skin(2, 3), np.arange(6.0)), "hdf5", tmp_path)
    with h5py.File(path, "a") as file:
        file["skin/taxels"].attrs["channels"] = "r0c0 r5c0"
    with pytest.raises(CsvError, match=r"taxels.*shape \(12, 2, 3\).*export the run again"):
        import_csv(path, tmp_path / "b.run")


def test_names_that_matlab_does_not_take_are_written_otherwise(tmp_path: Path) -> None:
    channels = (Channel("Kraft größte", "N", "force"), Channel("2nd", "V"), Channel("_x", "V"))
    (path,) = export(run_of(tmp_path, channels, np.arange(3.0)), "mat", tmp_path)
    read = loadmat(path, simplify_cells=True)
    assert read["tactile"] == "skin"
    assert read["skin"]["Kraft_gr__te"][0] == 0.0
    assert read["skin"]["x2nd"][0] == 1.0
    assert read["skin"]["x_x"][0] == 2.0
    assert read["skin"]["phase_names"] in ("idle", ["idle"])
    assert set(np.atleast_1d(read["skin"]["phase"])) == {1}
    assert json.loads(read["config"])["face_mm2"] == 25.0
