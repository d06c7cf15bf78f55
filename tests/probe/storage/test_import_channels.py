"""What an export brings back: the channels that its run was judged on, and what clipped."""

import math
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from one_press import Devices, one_press, pressed

from drivers import Channel
from drivers.core.arrays import Array, Bools
from probe.core.events import Samples
from probe.storage.csv_import import CsvError, import_csv
from probe.storage.export import export
from probe.storage.run import open_run
from probe.storage.writer import create_store

FORMS = ["csv", "parquet", "hdf5", "netcdf", "mcap"]
SAYING = FORMS[1:]  # what their channels are
TAXELS = tuple(Channel(f"r0c{n}", "Pa", "taxel", simulated=True) for n in range(24))
CELL = (Channel("force", "N", "force"), Channel("fx", "N"))


def run_of(
    folder: Path, channels: Devices, force: Array | None = None, clipped: Bools | None = None
) -> Path:
    """A run of one station; each channel reads another ramp, all of them ``force`` if given."""
    samples = []
    for d, (device, own) in enumerate(channels.items()):
        values = 100.0 * d + np.arange(len(own)) + 0.1 * np.arange(40.0)[:, None]
        if force is not None:
            values = np.repeat(force[:, None], len(own), axis=1)
        first = np.arange(len(own)) == 0
        marks = False if clipped is None else np.outer(clipped, first)
        samples.append(pressed(device, 0.01 * np.arange(1, 41), values, marks))
    return one_press(folder / "a.run", channels, samples)


def exported(run: Path, form: str, device: str) -> Path:
    files = export(run, [form], run.parent / "out")
    (file,) = (f for f in files if len(files) == 1 or f"-{device}" in f.name)
    return file


def same(run: Path, back: Path) -> bool:
    """Whether detection works on the same of both, to the bit."""
    (then,), (now,) = (open_run(one).recording().stations for one in (run, back))
    return np.array_equal(now.signal_pa, then.signal_pa, equal_nan=True) and np.array_equal(
        now.saturated, then.saturated
    )


@pytest.mark.parametrize("form", SAYING)
def test_taxels_come_back_although_a_load_cell_is_beside_them(form: str, tmp_path: Path) -> None:
    run = run_of(tmp_path, {"skin": TAXELS, "cell": CELL})
    back = import_csv(exported(run, form, "skin"), tmp_path / "b.run").path
    assert same(run, back)
    recording = open_run(back).recording()
    assert recording.channels == tuple(f"imported.{one.name}" for one in TAXELS)
    assert recording.face_m2 == pytest.approx(25e-6)
    assert len(recording.simulated) == len(TAXELS)


@pytest.mark.parametrize("form", SAYING)
@pytest.mark.parametrize("unit", ["N", "mN", "kPa"])
def test_a_channel_comes_back_whatever_its_name_and_unit(
    form: str, unit: str, tmp_path: Path
) -> None:
    role = "force" if unit.endswith("N") else "pressure"
    channels = {"a": (Channel("ecg", "mV"), Channel("pressed", unit, role)), "cell": CELL}
    run = run_of(tmp_path, channels)
    back = import_csv(exported(run, form, "a."), tmp_path / "b.run").path
    assert same(run, back)
    assert open_run(back).samples()["pressed"].attrs["units"] == unit


@pytest.mark.parametrize(
    ("form", "own"), [*((form, CELL) for form in FORMS), *((form, TAXELS) for form in SAYING)]
)
def test_what_clipped_is_still_known_to_have_clipped(
    form: str, own: tuple[Channel, ...], tmp_path: Path
) -> None:
    force = np.minimum(np.arange(40.0), 30.0)
    run = run_of(tmp_path, {"cell": own}, force, force == 30.0)
    assert open_run(run).recording().stations[0].saturated[:, 0].sum() == 10
    back = import_csv(exported(run, form, "cell"), tmp_path / "b.run", face_mm2=25.0).path
    assert same(run, back)


@pytest.mark.parametrize("form", SAYING)
def test_a_taxel_that_is_missing_for_a_while_is_missing_still(form: str, tmp_path: Path) -> None:
    events = list(open_run(run_of(tmp_path, {"skin": TAXELS})).events())
    with create_store(tmp_path / "gaps.run") as store:
        for event in events:
            if isinstance(event, Samples):
                event.block.values[[3, 9], 0] = math.nan
            store(event)
    back = import_csv(exported(tmp_path / "gaps.run", form, "skin"), tmp_path / "b.run").path
    assert same(tmp_path / "gaps.run", back)


Edit = Callable[[Path], object]


def replaced(old: str, new: str) -> Edit:
    return lambda file: file.write_text(file.read_text().replace(old, new, 1))


def without(name: str) -> Edit:
    def edit(file: Path) -> None:
        with h5py.File(file, "a") as opened:
            del (opened if name in opened else opened.attrs)[name]

    return edit


BOTH, ALONE = {"skin": TAXELS, "cell": CELL}, {"cell": CELL}
ECG = {"ecg": (Channel("lead", "mV", "reference"),)}
REFUSED: list[tuple[Devices, str, str, Edit, str]] = [
    (BOTH, "csv", "skin", Path.touch, r"no column of force_n, .*it has .*r0c0_Pa.*HDF5"),
    (ALONE, "csv", "cell", replaced("False", "perhaps"),
     "row 2, column 'force_saturated': 'perhaps'; True or False"),
    (ALONE, "csv", "cell", replaced("depth_mm", "depth_m"),
     "column 'depth_m': unknown unit; 'depth_mm' is read"),
    (BOTH, "hdf5", "", without("tactile"), r"which of skin, cell .*and 16 more.*import the CSV"),
    (BOTH, "hdf5", "", without("skin"), r"judged on 'skin'.*it has cell \(force, fx\)"),
    *((ECG, form, "ecg", Path.touch, r"no force, pressure or taxel channel.* \(lead\)")
      for form in SAYING),
]  # fmt: skip


@pytest.mark.parametrize(("channels", "form", "device", "edit", "said"), REFUSED)
def test_what_cannot_come_back_is_refused(
    channels: Devices, form: str, device: str, edit: Edit, said: str, tmp_path: Path
) -> None:
    file = exported(run_of(tmp_path, channels), form, device)
    edit(file)
    with pytest.raises(CsvError, match=said) as caught:
        import_csv(file, tmp_path / "b.run")
    assert str(file) in str(caught.value)
    assert not (tmp_path / "b.run").exists()


def test_an_older_file_of_one_sensor_need_not_say_which(tmp_path: Path) -> None:
    file = exported(run_of(tmp_path, ALONE), "hdf5", "")
    without("tactile")(file)
    assert import_csv(file, tmp_path / "b.run").samples == 40


@pytest.mark.parametrize("form", ["parquet", "hdf5", "mcap"])
def test_a_reading_that_no_device_says_is_refused(form: str, tmp_path: Path) -> None:
    force = np.arange(40.0)
    force[6] = 1e300
    file = exported(run_of(tmp_path, ALONE, force), form, "cell")
    with pytest.raises(CsvError, match=r"row 7, column '.*/force': 1e\+300; -1e\+06 to 1e\+06 N"):
        import_csv(file, tmp_path / "b.run")
