"""Recordings that other programs' own libraries wrote come in with the truth they hold."""

import struct
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from probe.storage.csv_import import CsvError, Imported, import_csv
from probe.storage.run import open_run

TIME_S = 0.01 * np.arange(200)
FORCE_N = 0.5 + 0.1 * np.sin(7 * TIME_S)
MAP = {"time_s": "t", "force_n": "Fz"}


def mat(path: Path) -> Path:
    scipy.io.savemat(path / "a.mat", {"t": TIME_S, "Fz": FORCE_N})
    return path / "a.mat"


def npz(path: Path) -> Path:
    np.savez(path / "a.npz", t=TIME_S, Fz=FORCE_N)
    return path / "a.npz"


def npy(path: Path) -> Path:
    held = np.array(list(zip(TIME_S, FORCE_N, strict=True)), [("t", "f8"), ("Fz", "f8")])
    np.save(path / "a.npy", held)
    return path / "a.npy"


def hdf5(path: Path) -> Path:
    with h5py.File(path / "a.h5", "w") as file:
        file["t"], file["Fz"] = TIME_S, FORCE_N
    return path / "a.h5"


def table(path: Path, name: str, head: str, mark: str, decimal: str) -> Path:
    rows = [
        mark.join(f"{value!r}".replace(".", decimal) for value in (float(t), float(f)))
        for t, f in zip(TIME_S, FORCE_N, strict=True)
    ]
    (path / name).write_text("\n".join([head, f"t{mark}Fz", f"s{mark}N", *rows, "9"]) + "\n")
    return path / name


def zwick(path: Path) -> Path:
    return table(path, "a.txt", "Pruefer;A. B.\nVorkraft;0,1;N\n", ";", ",")


def crowded(path: Path) -> Path:
    """A line of the table's width stands right above the names."""
    return table(path, "b.txt", "Pruefer;A. B.", ";", ",")


def labview(path: Path) -> Path:
    return table(path, "a.lvm", "LabVIEW Measurement\nWriter_Version\t2\n***End_of_Header***\n",
                 "\t", ".")  # fmt: skip


def plain(path: Path) -> Path:
    return table(path, "a.csv", "", ",", ".")


WRITERS = [mat, npz, npy, hdf5, zwick, crowded, labview, plain]


def imported(source: Path, tmp_path: Path, **keys: object) -> tuple[Imported, np.ndarray]:
    made = import_csv(source, tmp_path / "a.run", face_mm2=100.0, **keys)  # type: ignore[arg-type]
    (station,) = open_run(made.path).recording().stations
    return made, np.column_stack([station.time_s, 1e-4 * station.signal_pa[:, 0]])


@pytest.mark.parametrize("write", WRITERS)
def test_named_columns_come_in_from_every_format(
    write: Callable[[Path], Path], tmp_path: Path
) -> None:
    made, held = imported(write(tmp_path), tmp_path, mapping=MAP)
    np.testing.assert_allclose(held, np.column_stack([TIME_S, FORCE_N]), rtol=1e-12)
    broken = [note for note in made.notes if "not whole" in note]
    assert len(broken) == (write in (zwick, crowded, labview, plain))


def test_a_force_that_is_negative_when_pressed_is_turned_by_its_mapping(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"Fz": -FORCE_N})
    _, held = imported(tmp_path / "a.mat", tmp_path, mapping={"force_n": "-Fz"}, rate_hz=100.0)
    np.testing.assert_allclose(held, np.column_stack([TIME_S, FORCE_N]), rtol=1e-12)


@pytest.mark.parametrize("how", ["restart", "swapped"])
def test_times_that_go_back_are_put_right_and_said(how: str, tmp_path: Path) -> None:
    time_s = np.concatenate([TIME_S[:100], TIME_S[:100]])
    order = np.arange(200)
    if how == "swapped":
        order[[50, 51]] = order[[51, 50]]
        time_s = TIME_S[order]
    scipy.io.savemat(tmp_path / "a.mat", {"t": time_s, "Fz": FORCE_N[order]})
    made, held = imported(tmp_path / "a.mat", tmp_path, mapping=MAP)
    np.testing.assert_allclose(held, np.column_stack([TIME_S, FORCE_N]), atol=1e-9)
    assert any(("start anew" if how == "restart" else "put in the order") in n for n in made.notes)


def bag(path: Path, ros: int) -> Path:
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    types = store.types
    kind = "geometry_msgs/msg/WrenchStamped"
    zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    target = path / ("a.bag" if ros == 1 else "bag")
    writer = Writer1(target) if ros == 1 else Writer2(target, version=8)
    with writer as file:
        topic = file.add_connection("/ft", kind, typestore=store)
        for n, (time_s, force_n) in enumerate(zip(TIME_S, FORCE_N, strict=True)):
            stamp_ns = round(1e9 * time_s) + 5_000_000_000
            stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
            own = (n,) if ros == 1 else ()
            header = types["std_msgs/msg/Header"](*own, stamp, "ft")
            force = types["geometry_msgs/msg/Vector3"](float(force_n), 0.0, 0.0)
            message = types[kind](header, types["geometry_msgs/msg/Wrench"](force, zero))
            raw = (
                store.serialize_ros1(message, kind)
                if ros == 1
                else store.serialize_cdr(message, kind)
            )
            file.write(topic, stamp_ns, raw)
    return target if ros == 1 else next(target.glob("*.db3"))


@pytest.mark.parametrize("ros", [1, 2])
def test_a_bag_comes_in_with_the_force_along_any_axis(ros: int, tmp_path: Path) -> None:
    pytest.importorskip("rosbags.highlevel")
    mapping = {"force_n": "/ft.wrench.force.x"}
    _, held = imported(bag(tmp_path, ros), tmp_path, mapping=mapping)
    np.testing.assert_allclose(held, np.column_stack([TIME_S + 5.0, FORCE_N]), rtol=1e-9)


def chunk(tag: int, body: bytes) -> bytes:
    return b"\x04" + struct.pack("<IH", len(body) + 2, tag) + body


def xdf(path: Path, cut: int = 0) -> Path:
    """By the published format (sccn/xdf): one stream, doubles with a time each."""
    info = (
        "<?xml version='1.0'?><info><name>FT</name><type>F</type><channel_count>1</channel_count>"
        "<nominal_srate>100</nominal_srate><channel_format>double64</channel_format>"
        "<desc><channels><channel><label>Fz</label></channel></channels></desc></info>"
    )
    stream = struct.pack("<I", 1)
    samples = b"".join(
        b"\x08" + struct.pack("<dd", *pair) for pair in zip(TIME_S, FORCE_N, strict=True)
    )
    count = b"\x04" + struct.pack("<I", len(TIME_S))
    whole = b"XDF:" + chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")
    whole += chunk(2, stream + info.encode()) + chunk(3, stream + count + samples)
    whole += b"" if cut else chunk(6, stream + b"<?xml version='1.0'?><info></info>")
    (path / "a.xdf").write_bytes(whole)
    return path / "a.xdf"


@pytest.mark.parametrize("unfinished", [False, True])
def test_a_stream_of_xdf_comes_in_unfinished_too(unfinished: bool, tmp_path: Path) -> None:
    pytest.importorskip("pyxdf")
    made, held = imported(xdf(tmp_path, unfinished), tmp_path, mapping={"force_n": "FT/Fz"})
    np.testing.assert_allclose(held[:, 1], FORCE_N, rtol=1e-12)
    np.testing.assert_allclose(held[:, 0] - held[0, 0], TIME_S, atol=1e-6)
    assert any("was not finished" in note for note in made.notes) == unfinished


@pytest.mark.parametrize(
    ("name", "said"),
    [("a.tdms", "LabVIEW's TDMS, which is not read"), ("a.mat", "not a whole file of MATLAB"),
     ("a.bag", "not a whole file of ROS 1"), ("a.doc", ".doc is not known; read are .bag")],
)  # fmt: skip
def test_what_is_not_read_is_called_by_its_name(name: str, said: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"\x00something")
    with pytest.raises(CsvError, match=said):
        import_csv(tmp_path / name, tmp_path / "a.run")


def test_columns_without_a_mapping_are_listed(tmp_path: Path) -> None:
    with pytest.raises(CsvError, match=r"--map force_n=COLUMN .*it has 't', 'Fz'"):
        import_csv(mat(tmp_path), tmp_path / "a.run")
