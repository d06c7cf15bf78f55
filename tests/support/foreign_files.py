"""Recordings of one force, written by the libraries of other programs."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import scipy.io

TIME_S = 0.01 * np.arange(200)
FORCE_N = 0.5 + 0.1 * np.sin(7 * TIME_S)
COLUMNS = {"t": TIME_S, "Fz": FORCE_N}


def mat(path: Path, **more: Any) -> Path:
    scipy.io.savemat(path / "a.mat", COLUMNS | more)
    return path / "a.mat"


def mat73(path: Path) -> Path:
    """As MATLAB writes 7.3: HDF5 behind 512 bytes, each vector a row of a matrix."""
    with h5py.File(path / "a.mat", "w", userblock_size=512) as file:
        for name, values in COLUMNS.items():
            file[name] = values[None]
    with (path / "a.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
    return path / "a.mat"


def npz(path: Path) -> Path:
    np.savez(path / "a.npz", t=TIME_S, Fz=FORCE_N)
    return path / "a.npz"


def npy(path: Path) -> Path:
    held = np.array(list(zip(TIME_S, FORCE_N, strict=True)), [("t", "f8"), ("Fz", "f8")])
    np.save(path / "a.npy", held)
    return path / "a.npy"


def hdf5(path: Path) -> Path:
    """In groups, the force in mN by its attribute."""
    with h5py.File(path / "a.h5", "w") as file:
        file["data/t"], file["data/Fz"] = TIME_S, 1e3 * FORCE_N
        file["data/Fz"].attrs["units"] = "mN"
    return path / "a.h5"


def parquet(path: Path) -> Path:
    pd.DataFrame(COLUMNS).to_parquet(path / "a.parquet")
    return path / "a.parquet"


def table(
    name: str, head: str, mark: str, decimal: str = ".", gain: float = 1.0, more: str = ""
) -> Callable[[Path], Path]:
    """A text with ``head`` above its rows, the force times ``gain``."""

    def write(path: Path) -> Path:
        rows = [
            mark.join(f"{value!r}".replace(".", decimal) for value in (float(t), float(gain * f)))
            + more
            for t, f in zip(TIME_S, FORCE_N, strict=True)
        ]
        encoding = "utf-16" if name.endswith(".tsv") else "utf-8"
        (path / name).write_text("\n".join([head, *rows]) + "\n", encoding=encoding)
        return path / name

    return write


def ros_bag(ros: int, kind: str) -> Callable[[Path], Path]:
    """A bag of ROS 1, 2 (db3) or "3" (mcap) with a message of ``kind`` at /ft for each reading."""

    def write(path: Path) -> Path:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        serialize = store.serialize_ros1 if ros == 1 else store.serialize_cdr
        target = path / ("a.bag" if ros == 1 else "bag")
        plugin = StoragePlugin.MCAP if ros == 3 else StoragePlugin.SQLITE3
        writer: Any = Writer1(target)
        if ros > 1:
            writer = Writer2(target, version=9, storage_plugin=plugin)
        with writer as file:
            topic = file.add_connection("/ft", kind, typestore=store)
            for time_s, force_n in COLUMNS_OF_BAG:
                stamp_ns = round(1e9 * time_s) + 5_000_000_000
                value = message(store.types, kind, force_n, stamp_ns, (7,) if ros == 1 else ())
                file.write(topic, stamp_ns, serialize(value, kind))
        return target if ros == 1 else next(target.glob("bag*.*"))

    return write


COLUMNS_OF_BAG = list(zip(TIME_S.tolist(), FORCE_N.tolist(), strict=True))


def message(types: Any, kind: str, force_n: float, stamp_ns: int, number: tuple[int, ...]) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
    header = types["std_msgs/msg/Header"](*number, stamp, "ft")
    vector = types["geometry_msgs/msg/Vector3"]
    match kind.rpartition("/")[2]:
        case "Float64":
            return types[kind](force_n)
        case "Float64MultiArray":
            layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
            return types[kind](layout, np.array([0.0, 1e3 * force_n]))
        case "JointState":
            return types[kind](
                header, ["a", "b"], np.zeros(2), np.zeros(2), np.array([0.0, force_n])
            )
    wrench = types["geometry_msgs/msg/Wrench"](vector(force_n, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    return types[kind](header, wrench)


def chunk(tag: int, body: bytes) -> bytes:
    return b"\x04" + struct.pack("<IH", len(body) + 2, tag) + body


def stream(number: int, name: str, labels: list[str], unit: str, time_s: Any, values: Any) -> bytes:
    """By the published format (sccn/xdf): doubles with a time each, twenty in a chunk."""
    channels = "".join(
        f"<channel><label>{one}</label><unit>{unit}</unit></channel>" for one in labels
    )
    info = (
        f"<?xml version='1.0'?><info><name>{name}</name><type>F</type>"
        f"<channel_count>{len(labels)}</channel_count><nominal_srate>0</nominal_srate>"
        f"<channel_format>double64</channel_format><desc><channels>{channels}</channels></desc>"
        "</info>"
    )
    head = struct.pack("<I", number)
    rows = [
        b"\x08" + struct.pack(f"<d{len(labels)}d", t, *np.atleast_1d(v))
        for t, v in zip(time_s, values, strict=True)
    ]
    whole = chunk(2, head + info.encode())
    for n in range(0, len(rows), 20):
        part = rows[n : n + 20]
        whole += chunk(3, head + b"\x04" + struct.pack("<I", len(part)) + b"".join(part))
    return whole + chunk(6, head + b"<?xml version='1.0'?><info></info>")


def xdf(path: Path, *more: bytes) -> Path:
    start = b"XDF:" + chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")
    (path / "a.xdf").write_bytes(
        start + stream(1, "FT", ["Fz"], "mN", TIME_S, 1e3 * FORCE_N) + b"".join(more)
    )
    return path / "a.xdf"
