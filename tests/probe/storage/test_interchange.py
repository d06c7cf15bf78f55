"""What is exported opens elsewhere, and comes back to the bit."""

import math
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from one_press import one_press, pressed
from pyarrow import parquet
from ros_messages import ros_messages

from drivers import Channel
from probe.core.events import Event, Finish, Phase, PhaseEntered, Samples, StationEnded
from probe.storage.csv_import import CsvError, import_csv
from probe.storage.export import export
from probe.storage.run import open_run
from probe.storage.verify import verify
from probe.storage.writer import create_store

HOLDING_S = 4.8  # in the hold of the second press


each_form = pytest.mark.parametrize("form", ["csv", "parquet", "hdf5", "netcdf", "mcap"])


def exported(path: Path, form: str, folder: Path, device: str = "-force-") -> Path:
    """The one file, or of a table for each device that one."""
    files = export(path, [form], folder)
    (file,) = (f for f in files if len(files) == 1 or device in f.name)
    return file


def test_mcap_samples_are_read_to_the_bit_by_another_library(path: Path, tmp_path: Path) -> None:
    (file,) = export(path, ["mcap"], tmp_path)
    data, read = open_run(path).samples("force"), ros_messages(file, "/force/sample")
    assert np.array_equal([m.time_s for m in read], data["time_s"].values)
    for name in ("force", "von_mises"):
        assert np.array_equal([getattr(m, name) for m in read], data[name].values)
    assert np.array_equal([m.station for m in read], data["station"].values)
    assert np.array_equal([m.force_saturated for m in read], data["force_saturated"].values)
    holding = read[0].PHASE_HOLDING
    assert np.array_equal([m.phase == holding for m in read], data["phase"].values == "holding")
    stamps = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in read])
    assert np.diff(stamps) == pytest.approx(np.diff(data["time_s"].values), abs=1e-6)


def test_mcap_has_what_viewers_know(path: Path, tmp_path: Path) -> None:
    (file,) = export(path, ["mcap"], tmp_path)
    run = open_run(path)
    wrench = ros_messages(file, "/force/wrench")
    assert np.array_equal([m.wrench.force.z for m in wrench], run.samples()["force"].values)
    pose = ros_messages(file, "/stage/pose")
    assert np.array_equal([m.pose.position.z for m in pose], run.samples("stage")["z"].values)
    assert {m.pose.orientation.w for m in pose} == {1.0}
    assert {m.header.frame_id for m in pose} == {"scan"}
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        units = {c.topic: c.metadata.get("unit of force") for c in summary.channels.values()}
        assert units["/force/sample"] == "N"
        about, stations = reader.iter_attachments()
        assert b'"TIHA"' in about.data
        assert stations.data.startswith(b"station,attempt,x_mm")


@each_form
def test_what_export_wrote_is_imported(form: str, path: Path, tmp_path: Path) -> None:
    file = exported(path, form, tmp_path)
    back = open_run(import_csv(file, tmp_path / "back.run", face_mm2=100.0).path)
    then, now = open_run(path).samples(), back.samples()
    pressed = then.isel(time_s=then["station"].values >= 0)
    assert np.array_equal(now["force"].values, pressed["force"].values)
    assert np.array_equal(now["time_s"].values, pressed["time_s"].values)
    assert np.array_equal(now["station"].values, pressed["station"].values)
    depths_m = [
        [one.hold_depth_m for one in run.recording().stations] for run in (open_run(path), back)
    ]
    assert depths_m[1] == pytest.approx(depths_m[0], rel=1e-9)
    assert min(depths_m[0]) > 1e-3
    assert back.stations()["x_mm"].to_list() == pytest.approx([28, 32], abs=1e-3)
    assert back.simulated == ("imported.force",)
    for one, other in zip(
        back.recording().stations, open_run(path).recording().stations, strict=True
    ):
        assert one.hold_s == pytest.approx(other.hold_s, abs=5e-3)  # to a sample
        assert one.retract_s == pytest.approx(other.retract_s, abs=5e-3)
        assert np.array_equal(one.time_s, other.time_s)  # since the tare
        held = [(s.time_s >= s.hold_s) & (s.time_s <= s.retract_s) for s in (one, other)]
        assert np.array_equal(*held)
    assert verify(back.path).problems == ()


BESIDE = {"imported": Channel("force", "N", "force"), "ecg": Channel("lead II", "mV", "reference")}


@pytest.mark.parametrize("form", ["hdf5", "netcdf", "mcap"])
@pytest.mark.parametrize("together", [True, False])
def test_a_reference_and_the_face_come_back_too(form: str, together: bool, tmp_path: Path) -> None:
    time_s, beats_s = np.linspace(0.1, 0.9, 40), np.linspace(0.05, 0.95, 31)
    force, beats = np.arange(40.0), np.sin(np.arange(31.0))
    if together:
        beats_s, beats = time_s, np.sin(np.arange(40.0))
        channels = {"cell": tuple(BESIDE.values())}
        samples = [pressed("cell", time_s, np.column_stack([force, beats]))]
    else:
        channels = {n: (c,) for n, c in BESIDE.items()}
        samples = [pressed("imported", time_s, force), pressed("ecg", beats_s, beats)]
    path = one_press(tmp_path / "a.run", channels, samples)
    (file,) = export(path, [form], tmp_path)
    imported = import_csv(file, tmp_path / "back.run")
    (station,) = open_run(imported.path).recording().stations
    assert np.array_equal(station.reference_s, beats_s)
    assert np.array_equal(station.reference, beats)
    assert np.array_equal(station.signal_pa[:, 0], force / 25e-6)
    assert open_run(imported.path).simulated == ()
    assert imported.notes == ()


@each_form
def test_an_infinite_reading_is_none(form: str, tmp_path: Path) -> None:
    force = np.arange(40.0)
    force[[3, 7]] = math.inf, -math.inf
    samples = [pressed("imported", np.linspace(0.1, 0.9, 40), force)]
    path = one_press(tmp_path / "a.run", {"imported": (BESIDE["imported"],)}, samples)
    file = exported(path, form, tmp_path, "-imported")
    imported = import_csv(file, tmp_path / "back.run", face_mm2=100.0)
    assert imported.samples == 38
    assert "2 rows without a reading are left out" in imported.notes


def cut_off(path: Path, copy: Path, is_last: Callable[[Event], bool]) -> Path:
    """A run that ended, as by a loss of power, after the first event that ``is_last``."""
    with create_store(copy) as store:
        for event in open_run(path).events():
            store(event)
            if is_last(event):
                return copy
    raise AssertionError("no such event")


@each_form
def test_a_run_that_broke_off_before_its_hold_is_exported_and_imported(
    form: str, path: Path, tmp_path: Path
) -> None:
    broken = cut_off(
        path, tmp_path / "broken.run",
        lambda e: isinstance(e, PhaseEntered) and e.phase == "holding" and e.time_s > 4.0,
    )  # fmt: skip
    assert len(open_run(broken).stations()) == 2
    file = exported(broken, form, tmp_path)
    back = open_run(import_csv(file, tmp_path / "back.run", face_mm2=100.0).path)
    then = open_run(broken).samples()
    pressed = then.isel(time_s=then["station"].values >= 0)
    assert np.array_equal(back.samples()["force"].values, pressed["force"].values)
    assert back.stations()["x_mm"].to_list() == pytest.approx([28, 32], abs=1e-3)


@each_form
@pytest.mark.parametrize("says", [True, False])
def test_a_press_that_broke_off_is_judged_nowhere(
    form: str, says: bool, path: Path, tmp_path: Path
) -> None:
    broken = cut_off(
        path, tmp_path / "broken.run",
        lambda e: isinstance(e, Samples) and e.block.time_s[-1] > HOLDING_S,
    )  # fmt: skip
    if says:
        *events, end = [*open_run(path).events()]
        stopped = tmp_path / "stopped.run"
        with create_store(stopped) as store:
            for event in events:
                if isinstance(event, StationEnded) and event.station == 1:
                    store(PhaseEntered(event.time_s - 0.01, Phase.STOPPING, 1))
                    event = replace(event, complete=False)
                store(event)
            store(replace(end, finish=Finish.FAULTED))
        broken = stopped
    file = exported(broken, form, tmp_path)
    imported = import_csv(file, tmp_path / "back.run", face_mm2=100.0)
    back = open_run(imported.path)
    assert "presses that broke off are kept, and not judged: station 2" in imported.notes
    assert [one.x_m for one in back.recording().stations] == [0.028]
    assert back.finish is not Finish.COMPLETED
    assert len(back.stations()) == 2
    assert verify(back.path).ok


@each_form
def test_a_run_without_a_sample_is_exported_and_no_recording(
    form: str, path: Path, tmp_path: Path
) -> None:
    empty = cut_off(path, tmp_path / "empty.run", lambda _event: True)
    file = exported(empty, form, tmp_path)
    with pytest.raises(CsvError, match="no rows below the column names"):
        import_csv(file, tmp_path / "back.run", face_mm2=100.0)


def test_parquet_carries_units(path: Path, tmp_path: Path) -> None:
    file = next(f for f in export(path, ["parquet"], tmp_path) if "-force-" in f.name)
    schema = parquet.read_schema(file)
    said = {b"units": b"N", b"role": b"force", b"simulated": b"1", b"channel": b"force"}
    assert schema.field("force_N").metadata == said
    assert schema.field("time_s").metadata == {b"units": b"s"}


def wrenches(file: Path, topics: dict[str, list[float]]) -> None:
    """An MCAP file as a ROS 2 recorder writes it: one WrenchStamped per force, 10 ms apart."""
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=512)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("geometry_msgs/msg/WrenchStamped", "ros2msg", b"")
        for topic, forces in topics.items():
            channel = writer.register_channel(topic, "cdr", schema)
            for n, force in enumerate(forces):
                head = struct.pack("<iII", 100, n * 10_000_000, 5) + b"tool\0"
                body = head.ljust(-(-len(head) // 8) * 8, b"\0")
                body += struct.pack("<6d", 1.0, 2.0, force, 0.0, 0.0, 0.0)
                writer.add_message(channel, n, b"\0\1\0\0" + body, n)
        writer.finish()


@pytest.mark.parametrize(("column", "value"), [("force.x", 1.0), ("-force.y", -2.0)])
def test_a_wrench_is_turned_by_a_mapping(column: str, value: float, tmp_path: Path) -> None:
    wrenches(tmp_path / "other.mcap", {"/ft": [0.1 * n for n in range(20)]})
    made = import_csv(tmp_path / "other.mcap", tmp_path / "a.run", mapping={"force_n": column})
    assert set(open_run(made.path).samples()["force"].values) == {value}
    with pytest.raises(CsvError, match=r"torque.x is in Nm; wanted is one of N"):
        import_csv(tmp_path / "other.mcap", tmp_path / "b.run", mapping={"force_n": "torque.x"})


def test_of_an_unfinished_mcap_what_is_whole_is_read(tmp_path: Path) -> None:
    forces = [0.1 * n for n in range(200)]
    wrenches(tmp_path / "whole.mcap", {"/ft": forces})
    whole = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "died.mcap").write_bytes(whole[: len(whole) // 3])
    made = import_csv(tmp_path / "died.mcap", tmp_path / "a.run", face_mm2=50.0)
    samples = open_run(made.path).samples()
    kept = samples["force"].values.tolist()
    assert np.diff(samples["time_s"].values) == pytest.approx(0.01)
    assert 20 < len(kept) < 180
    assert kept == forces[: len(kept)]
    assert made.notes == ("the file was not finished; what is whole is read (`mcap recover`)",)


def test_of_two_wrenches_one_must_be_named(tmp_path: Path) -> None:
    file = tmp_path / "two.mcap"
    wrenches(file, {"/a": [1.0] * 9, "/b": [2.0] * 9})
    with pytest.raises(CsvError, match=r"which column is the signal.*'/a.wrench.force.x'"):
        import_csv(file, tmp_path / "a.run")
    made = import_csv(file, tmp_path / "b.run", topic="/b")
    assert set(open_run(made.path).samples()["force"].values) == {2.0}


@pytest.mark.parametrize("ending", [".mcap", ".parquet", ".h5", ".nc"])
def test_a_file_that_is_none_is_refused(ending: str, tmp_path: Path) -> None:
    file = tmp_path / f"none{ending}"
    file.write_bytes(b"nothing of the kind" * 10)
    with pytest.raises(CsvError, match="none"):
        import_csv(file, tmp_path / "a.run")


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
@pytest.mark.parametrize("phase", ["dwell", 3.0, ""])
def test_phases_in_words_of_others_are_none(
    ending: str, phase: str | float, tmp_path: Path
) -> None:
    time_s = np.arange(0.0, 12.0, 0.01)
    force_n = np.interp(time_s, [1, 2, 9, 10], [0.0, 1.0, 1.0, 0.0])
    table = pd.DataFrame(
        {"time_s": time_s, "station": 0, "attempt": 1, "force_n": force_n, "phase": phase}
    )
    file = tmp_path / f"press{ending}"
    table.to_csv(file, index=False) if ending == ".csv" else table.to_parquet(file)
    back = open_run(import_csv(file, tmp_path / "back.run", face_mm2=100.0).path)
    assert np.array_equal(back.samples()["force"].values, force_n)
    (station,) = back.recording().stations
    assert math.isnan(station.hold_s)
    assert len(station.time_s) == len(time_s)
