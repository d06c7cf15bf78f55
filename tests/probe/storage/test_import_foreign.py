"""Recordings that other programs' own libraries wrote come in with the truth they hold."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from foreign_files import (
    COLUMNS,
    FORCE_N,
    TIME_S,
    hdf5,
    mat,
    mat73,
    npy,
    npz,
    parquet,
    ros_bag,
    stream,
    table,
    xdf,
)

from probe.storage.csv_import import CsvError, Imported, import_csv
from probe.storage.run import open_run

ZWICK = "Pruefer;A. B.\nVorkraft;0,1;N\n\nZeit;Standardkraft\ns;mN"
BIOINDENTER = "Bioindenter export\nSample\tgel\nTip (um)\t500\n\nTime [ms]\tFn [uN]"
LVM = "LabVIEW Measurement\nWriter_Version\t2\n***End_of_Header***\nX_Value\tFz\tComment"
T, F = {"time_s": "t"}, {"force_n": "Fz"}
WRENCH = "geometry_msgs/msg/WrenchStamped"
FORMATS: dict[str, tuple[Callable[[Path], Path], dict[str, Any]]] = {
    "mat": (mat, T | F),
    "mat 7.3": (mat73, T | F),
    "npz": (npz, T | F),
    "npy": (npy, T | F),
    "hdf5": (hdf5, T | F),
    "parquet": (parquet, T | F),
    "xdf": (xdf, F),
    "zwick": (table("a.txt", ZWICK, ";", ",", 1e3), {"time_s": "Zeit", "force_n": "Standardkraft"}),
    "zwick by its unit": (
        table("a.txt", ZWICK, ";", ",", 1e3), {"force_n": "Standardkraft [mN]"}),
    "ta-xt": (
        table("a.tab", "Time (s)\tForce (g)", "\t", gain=1e3 / 9.80665), {"force_n": "Force"}),
    "bioindenter": (
        lambda path: table("a.txt", BIOINDENTER, "\t", gain=1e6)(path), {"force_n": "Fn [uN]"}),
    "labview": (table("a.lvm", LVM, "\t"), {"time_s": "X_Value"} | F),
    "utf-16": (table("a.tsv", "t\tFz", "\t"), T | F),
    "words beside": (table("a.csv", "t;Fz;state", ";", ",", more=";ok"), T | F),
    "spaces": (table("a.dat", "t [s]  Fz [N]", " "), F),
    "ur": (
        table("a.csv", "timestamp actual_TCP_force_2", " "),
        {"time_s": "timestamp", "force_n": "actual_TCP_force_2"},
    ),
    "our names": (table("a.csv", "time_s;force_n", ";", ","), {}),
    "bag": (ros_bag(1, WRENCH), {"force_n": "force.x"}),
    "db3": (ros_bag(2, WRENCH), {"force_n": "/ft.wrench.force.x"}),
    "mcap": (ros_bag(3, WRENCH), {"force_n": "force.x"}),
    "float": (ros_bag(1, "std_msgs/msg/Float64"), {"force_n": "/ft.data"}),
    "joints": (ros_bag(2, "sensor_msgs/msg/JointState"), {"force_n": "effort[1]"}),
    "array": (ros_bag(2, "std_msgs/msg/Float64MultiArray"), {"force_n": "/ft.data[1] [mN]"}),
}  # fmt: skip
CHANGED_IN_MS = {"bioindenter"}


def imported(source: Path, tmp_path: Path, **keys: Any) -> tuple[Imported, Any]:
    made = import_csv(source, tmp_path / "a.run", face_mm2=100.0, **keys)
    (station,) = open_run(made.path).recording().stations
    return made, np.column_stack([station.time_s, 1e-4 * station.signal_pa[:, 0]])


@pytest.mark.parametrize("form", FORMATS)
def test_a_file_of_its_own_library_comes_in_with_its_truth(form: str, tmp_path: Path) -> None:
    write, mapping = FORMATS[form]
    made, held = imported(write(tmp_path), tmp_path, mapping=mapping)
    np.testing.assert_allclose(held[:, 1], FORCE_N, rtol=1e-12)
    rate = 1e-3 if form in CHANGED_IN_MS else 1.0
    np.testing.assert_allclose(held[:, 0] - held[0, 0], rate * TIME_S, atol=1e-6)
    assert not any("lost" in note or "not whole" in note for note in made.notes)


REFUSED_CUT = {
    **dict.fromkeys(["npz", "hdf5", "mat 7.3", "parquet"], r"a\.\w+: not a whole file of"),
    **dict.fromkeys(["mcap", "array"], "no whole message of numbers is in it; the .* is read"),
    "mat": r"Fz: no such column; it has 't'; the file ends within a variable: \d+ bytes are lost",
}
"""Formats whose readings are gone with the end of so small a file."""


@pytest.mark.parametrize("form", FORMATS)
def test_of_a_damaged_file_what_is_whole_is_read_and_the_rest_said(
    form: str, tmp_path: Path
) -> None:
    write, mapping = FORMATS[form]
    source = write(tmp_path)
    content = source.read_bytes()
    source.write_bytes(content[: 2 * len(content) // 3 - 1])
    if form in REFUSED_CUT:
        with pytest.raises(CsvError, match=REFUSED_CUT[form]):
            imported(source, tmp_path, mapping=mapping)
        return
    made, held = imported(source, tmp_path, mapping=mapping)
    assert 40 < len(held) < 150
    np.testing.assert_allclose(held[:-1, 1], FORCE_N[: len(held) - 1], rtol=1e-12)
    said = ("lost", "not whole", "not finished", "cut off", "damaged", "missing")
    assert any(word in note for note in made.notes for word in said), made.notes


@pytest.mark.parametrize("kept", [1, 3, 5, 6, 8, 30])
def test_an_xdf_file_may_end_anywhere_in_a_chunk(kept: int, tmp_path: Path) -> None:
    source = xdf(tmp_path)
    content = source.read_bytes()
    last = content.rindex(struct.pack("<HI", 3, 1)) - 5  # the last chunk of samples
    source.write_bytes(content[: last + kept])
    made, held = imported(source, tmp_path, mapping=F)
    np.testing.assert_allclose(held[:, 1], FORCE_N[:180])
    assert f"the file ends within a chunk: {kept} of {last + kept} bytes are lost" in made.notes


def test_each_stream_keeps_its_rate_and_an_array_its_layout(tmp_path: Path) -> None:
    slow_s, depth_s = TIME_S[::4] + 1e-3, TIME_S[::10] + 2e-3
    taxels = np.arange(50 * 6.0).reshape(50, 6)
    source = xdf(
        tmp_path,
        stream(2, "skin", list("abcdef"), "kPa", slow_s, taxels),
        stream(3, "arm", ["z"], "m", depth_s, 1e-3 * np.arange(20)),
    )
    mapping = {"force_n": "FT/Fz", "taxels_pa": "skin", "depth_mm": "arm/z"}
    made = import_csv(source, tmp_path / "a.run", mapping=mapping, layout=(2, 3), face_mm2=100.0)
    run = open_run(made.path)
    assert [len(run.samples(device)["time_s"]) for device in run.channels] == [200, 50, 20]
    skin = run.samples("taxels")
    np.testing.assert_allclose(skin["time_s"], slow_s)
    np.testing.assert_allclose(skin["taxels"][:, 1, 2], 1e3 * taxels[:, 5])
    names = " ".join(channel.name for channel in run.channels["taxels"])
    assert names == "r0c0 r0c1 r0c2 r1c0 r1c1 r1c2"
    (station,) = run.recording().stations
    np.testing.assert_allclose(station.signal_pa[:, 0], 1e4 * FORCE_N)
    np.testing.assert_allclose(1e3 * station.depth_m[5:180], TIME_S[5:180] / 0.1 - 0.02, atol=1e-9)
    assert made.notes == ()


@pytest.mark.parametrize("how", ["array", "columns"])
def test_taxels_alone_are_the_signal(how: str, tmp_path: Path) -> None:
    skin = np.random.default_rng(1).random((200, 4, 7))
    if how == "array":
        scipy.io.savemat(tmp_path / "a.mat", {"t": TIME_S, "skin": skin})
        source, mapping, layout = tmp_path / "a.mat", T | {"taxels_n": "skin"}, None
    else:
        names = [f"p{n}" for n in range(28)]
        pd.DataFrame(skin.reshape(200, 28), columns=names).assign(t=TIME_S).to_csv(
            tmp_path / "a.csv", index=False
        )
        source, mapping, layout = tmp_path / "a.csv", T | {"taxels_n": "p*"}, (4, 7)
    made = import_csv(source, tmp_path / "a.run", mapping=mapping, layout=layout, face_mm2=28.0)
    recording = open_run(made.path).recording()
    assert recording.channels[8] == "imported.r1c1"
    np.testing.assert_allclose(recording.stations[0].signal_pa, 1e6 * skin.reshape(200, 28))


def test_streams_in_one_file_of_arrays_have_the_times_beside_them(tmp_path: Path) -> None:
    """Two of one length too: by the names of the times."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["ft/t"], file["ft/Fz"] = TIME_S, FORCE_N
        file["ppg/t"], file["ppg/light"] = TIME_S + 0.005, np.cos(TIME_S)
    mapping = {"time_s": ["ft/t", "ppg/t"], "force_n": "Fz", "reference": "light"}
    made = import_csv(tmp_path / "a.h5", tmp_path / "a.run", mapping=mapping, face_mm2=100.0)
    (station,) = open_run(made.path).recording().stations
    np.testing.assert_allclose(station.time_s, TIME_S)
    np.testing.assert_allclose(station.reference_s, TIME_S + 0.005)


def test_a_press_with_its_depths_has_phases(tmp_path: Path) -> None:
    """Down from the surface in 0.5 s, still for 1 s, and up: by a stage that trembles, too."""
    for tremble_mm in (0.0, 3e-3):
        depth_mm = np.interp(TIME_S, [0.2, 0.7, 1.7, 1.9], [0.0, 2.5, 2.5, 0.0])
        depth_mm += tremble_mm * np.random.default_rng(1).standard_normal(200)
        table = pd.DataFrame({"time_s": TIME_S, "force_n": depth_mm, "depth_mm": depth_mm})
        table.to_csv(tmp_path / "a.csv", index=False)
        made = import_csv(tmp_path / "a.csv", tmp_path / f"{tremble_mm}.run", face_mm2=100.0)
        (station,) = open_run(made.path).recording().stations
        phases = (station.indent_s, station.hold_s, station.retract_s)
        assert phases == pytest.approx((0.2, 0.7, 1.7), abs=0.02)
        assert station.hold_depth_m == pytest.approx(2.5e-3, rel=2e-3)


def test_moments_are_times_and_what_was_asked_is_kept(tmp_path: Path) -> None:
    moments = pd.Timestamp("2026-03-01T12:00:00") + pd.to_timedelta(TIME_S, unit="s")
    table = pd.DataFrame({"when": moments.strftime("%Y-%m-%d %H:%M:%S.%f"), "Fz": FORCE_N})
    table.to_csv(tmp_path / "a.csv", index=False, sep=";", decimal=",")
    made, held = imported(tmp_path / "a.csv", tmp_path, mapping={"time_s": "when", "force_n": "Fz"})
    np.testing.assert_allclose(held[:, 0] - held[0, 0], TIME_S, atol=1e-6)
    asked = open_run(made.path).config["imported"]["asked"]
    assert asked["mapping"] == {"time_s": "when", "force_n": "Fz"}


def test_words_may_name_stations(tmp_path: Path) -> None:
    table = pd.DataFrame(COLUMNS).assign(trial=["first"] * 80 + ["second"] * 120)
    table.to_csv(tmp_path / "a.csv", index=False)
    made = import_csv(tmp_path / "a.csv", tmp_path / "a.run", mapping=T | F | {"station": "trial"})
    assert made.stations == 2


def test_a_force_that_is_negative_when_pressed_is_turned_by_its_mapping(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"Fz": -1e3 * FORCE_N})
    _, held = imported(tmp_path / "a.mat", tmp_path, mapping={"force_n": "-Fz [mN]"}, rate_hz=100.0)
    np.testing.assert_allclose(held, np.column_stack([TIME_S, FORCE_N]), rtol=1e-12)


def test_times_that_start_anew_go_on_and_that_is_said(tmp_path: Path) -> None:
    time_s = np.concatenate([TIME_S[:100], TIME_S[:100]])
    scipy.io.savemat(tmp_path / "a.mat", {"t": time_s, "Fz": FORCE_N})
    made, held = imported(tmp_path / "a.mat", tmp_path, mapping=T | F)
    np.testing.assert_allclose(held, np.column_stack([TIME_S, FORCE_N]), atol=1e-9)
    assert any("start anew" in note for note in made.notes)


RAMP_N = np.interp(TIME_S, [0.5, 1.0], [0.0, 1.0])
NOISE_N = 1e-3 * np.random.default_rng(1).standard_normal(200)
DOUBTFUL = {
    "untared": (RAMP_N + NOISE_N + 3.3, r"the press begins at 3\.3 N: .*--tare-s 0\.1 takes"),
    "two sensors": (
        np.where(np.arange(200) % 2, RAMP_N + 1.0, -0.5) + NOISE_N,
        "every other row is of another level: are two sensors in one table",
    ),
    "in contact from its beginning": (3.3 + NOISE_N, None),
    "right": (RAMP_N + NOISE_N, None),
}


@pytest.mark.parametrize("case", DOUBTFUL)
def test_what_looks_wrong_is_said_once(case: str, tmp_path: Path) -> None:
    force_n, said = DOUBTFUL[case]
    pd.DataFrame({"time_s": TIME_S, "force_n": force_n}).to_csv(tmp_path / "a.csv", index=False)
    made, held = imported(tmp_path / "a.csv", tmp_path)
    assert len(made.notes) == (said is not None)
    if said is not None:
        assert pd.Series(made.notes).str.contains(said).all(), made.notes
    if case == "untared":
        tared = import_csv(tmp_path / "a.csv", tmp_path / "b.run", face_mm2=100.0, tare_s=0.4)
        assert tared.notes == ()
        force = open_run(tared.path).samples()["force"].to_numpy()
        np.testing.assert_allclose(force, held[:, 1] - held[:40, 1].mean(), atol=1e-9)


def test_the_block_of_a_scene_and_the_face_of_its_finger_are_known(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text('[scan]\nstart_mm = 4\n[scene]\nname = "TIHA"\n')
    blocks = []
    for n, known in enumerate(({"scene": "TIHA"}, {"rig": tmp_path / "rig.toml"})):
        made = import_csv(mat(tmp_path), tmp_path / f"{n}.run", mapping=T | F, **known)
        assert made.notes == ()
        recording = open_run(made.path).recording()
        assert recording.face_m2 == pytest.approx(1e-4)
        blocks.append(recording.block)
    assert blocks[0] == blocks[1]
    assert blocks[0]["tissue"]["width_mm"] == 64
    assert "inclusion" not in blocks[0]


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "no mapping": ({}, r"--map force_n=COLUMN .*it has 't', 'Fz', 'skin' \(3\)"),
    "no such column": ({"mapping": T | F | {"x_mm": "x"}}, "x_mm=x: no such column; it has 't'"),
    "no such name": ({"mapping": {"force": "Fz"}}, "--map force: not known; allowed are time_s"),
    "two signals": (
        {"mapping": F | {"pressure_pa": "Fz"}}, "force_n and pressure_pa is said"),
    "no times": ({"mapping": F}, "Fz has no times: say --rate-hz, or --map time_s=COLUMN"),
    "an array": ({"mapping": T | {"force_n": "skin"}}, r"an array of 3; say one of it, as skin\[0"),
    "not one of it": ({"mapping": T | {"force_n": "skin[3]"}}, r"skin\[3\]: no such column"),
    "another kind of unit": (
        {"mapping": T | {"force_n": "Fz [kPa]"}}, "Fz is in kPa; wanted is one of N, uN, mN"),
    "no unit": ({"mapping": T | {"force_n": "Fz [foo]"}}, "unit 'foo' is not known; one of N"),
    "another rate": (
        {"mapping": T | F, "rate_hz": 1000.0},
        "--rate-hz 1000 is not the rate of Fz, whose times are 100 Hz"),
    "another layout": (
        {"mapping": T | {"taxels_pa": "skin"}, "layout": (4, 7)},
        "--layout 4x7: 28 taxels, but skin has 3"),
    "another topic": ({"topic": "/ft"}, "--topic /ft: not there; it has 't', 'Fz'"),
    "a tare of nothing": ({"mapping": T | F, "tare_s": 0.0}, "station 1 has no reading in it"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_asked_wrongly_is_refused_with_what_is_there(case: str, tmp_path: Path) -> None:
    keys, said = REFUSED[case]
    source = mat(tmp_path, skin=np.zeros((200, 3)))
    with pytest.raises(CsvError, match=said):
        import_csv(source, tmp_path / "a.run", **keys)
    assert not (tmp_path / "a.run").exists()


def test_a_rate_is_held_against_times_that_nobody_named(tmp_path: Path) -> None:
    source = table("a.txt", "Time [s]\tFz", "\t")(tmp_path)
    with pytest.raises(CsvError, match=r"--rate-hz 500 is not .* are 100 Hz"):
        imported(source, tmp_path, mapping=F, rate_hz=500.0)
    _, held = imported(source, tmp_path, mapping=F, rate_hz=100.5)
    np.testing.assert_allclose(held[:, 0], TIME_S)


def test_of_two_columns_that_fit_one_must_be_said(tmp_path: Path) -> None:
    again = stream(2, "FT", ["Fz"], "N", TIME_S, FORCE_N)
    with pytest.raises(CsvError, match=r"2 of that name: FT#1/Fz, FT#2/Fz; say which"):
        imported(xdf(tmp_path, again), tmp_path, mapping=F)
    _, held = imported(tmp_path / "a.xdf", tmp_path, mapping={"force_n": "FT#2/Fz"})
    np.testing.assert_allclose(held[:, 1], FORCE_N)


def test_streams_whose_times_go_back_are_not_put_together(tmp_path: Path) -> None:
    other = stream(2, "arm", ["z"], "m", TIME_S[::2][::-1], TIME_S[:100])
    with pytest.raises(CsvError, match="arm/z: its times go back, and other streams"):
        imported(xdf(tmp_path, other), tmp_path, mapping=F | {"depth_mm": "arm/z"})


@pytest.mark.parametrize("name, content, said", [
    ("a.tdms", b"TDSm", "LabVIEW's TDMS, which is not read"),
    ("a.dat", b"TDSm\x0e", "LabVIEW's TDMS, which is not read"),
    ("a.xlsx", b"PK", "an Excel workbook, which is not read"),
    ("a.run", b"", "a run of palpate, which needs no import"),
    ("a.mat", b"\0something", "not a whole file of MATLAB"),
    ("a.bag", b"\0something", "is no ROS 1 bag"),
    ("a.xdf", b"\0something", "is no XDF file"),
    ("a.db3", b"\0something", "no whole message of numbers is in it"),
    ("a.lvm", b"LabVIEW Measurement\nnothing", "no table .* is a LabVIEW measurement file"),
    ("a.doc", b"\0something", ".doc is not known; read are .mat"),
])  # fmt: skip
def test_what_is_not_read_is_called_by_its_name(
    name: str, content: bytes, said: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CsvError, match=said):
        import_csv(tmp_path / name, tmp_path / "b.run")


def test_a_file_is_known_by_its_beginning_whatever_it_is_called(tmp_path: Path) -> None:
    _, held = imported(hdf5(tmp_path).rename(tmp_path / "a.dat"), tmp_path, mapping=T | F)
    np.testing.assert_allclose(held[:, 1], FORCE_N)


def test_the_format_of_a_robots_own_record_is_called_by_its_name(tmp_path: Path) -> None:
    write, mapping = FORMATS["ur"]
    made, _ = imported(write(tmp_path), tmp_path, mapping=mapping)
    assert any("a UR's own record: --map time_s=timestamp" in note for note in made.notes)
