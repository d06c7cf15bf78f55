"""Recordings made elsewhere become runs like any other."""

import gzip
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from paths import SHARED

from probe.core.events import Finish, Note
from probe.storage.csv_import import CsvError, import_csv
from probe.storage.csv_table import cut, read_csv
from probe.storage.run import open_run
from probe.storage.verify import verify
from probe.storage.writer import StoreError

REAL = SHARED / "real"


def csv(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def table(header: str, *rows: str) -> str:
    return "\n".join([header, *rows]) + "\n"


STEADY = [f"{n / 100:g},{n % 7}" for n in range(50)]


def test_one_recording_without_a_place(tmp_path: Path) -> None:
    source = csv(tmp_path / "a.csv", table("time_s,pressure_mbar", *STEADY))
    imported = import_csv(source, tmp_path / "a.run")
    assert (imported.stations, imported.samples, imported.notes) == (1, 50, ())
    report = verify(imported.path)
    assert report.ok, report.problems
    run = open_run(imported.path)
    (station,) = run.recording().stations
    assert station.signal_pa[:8, 0] == pytest.approx(100.0 * (np.arange(8) % 7))
    assert station.time_s == pytest.approx(np.arange(50) / 100)
    assert np.isnan([station.x_m, station.y_m, station.indent_s, station.hold_s]).all()
    assert np.isnan(station.depth_m).all()
    assert run.simulated == ()
    assert run.finish is Finish.COMPLETED
    assert run.samples()["pressure"].attrs["units"] == "mbar"


@pytest.mark.parametrize("columns, row, noted", [
    ("force_n", lambda n: 0.8 * n / 49, ""),
    ("force_n", lambda n: 800 * n / 49, "spans 0 to 800 N, where no press.*is it in mN?"),
    ("pressure_mbar", lambda n: n % 7 + 0.5, ""),
    ("pressure_mbar", lambda n: 0.5 - n % 7, "pressed is positive"),
    ("pressure_pa,station", lambda n: f"{n % 7},{n // 10}", ""),
    ("pressure_pa,station,x_mm,y_mm", lambda n: f"{n % 7},{n // 10},3,2", ""),
    ("pressure_pa,station,x_mm,y_mm",
     lambda n: f"{n % 7},{n // 10},{4 * (n // 10)},{4 * (n // 30)}", ""),
    ("pressure_pa,station,x_mm,y_mm",  # all of them one place by `SAME_PLACE_M`
     lambda n: f"{n % 7},{n // 10},{4e-3 * (n // 10)},{4e-3 * (n // 30)}",
     "x_mm, y_mm: 6 places span 0.02 mm in all"),
    ("force_n,depth_mm", lambda n: f"{1 + n % 3},-2.5",
     "depth_mm is never above 0: here it is positive below the surface"),
])  # fmt: skip
def test_what_looks_wrong_is_noted_and_nothing_else(
    columns: str, row: Callable[[int], object], noted: str, tmp_path: Path
) -> None:
    rows = [f"{n / 100:g},{row(n)}" for n in range(60 if "station" in columns else 50)]
    source = csv(tmp_path / "a.csv", table(f"time_s,{columns}", *rows))
    notes = import_csv(source, tmp_path / "a.run", face_mm2=100.0).notes
    assert len(notes) == bool(noted)
    for note in notes:
        assert re.search(noted, note)


def test_depths_are_those_of_the_file(tmp_path: Path) -> None:
    """Of a probe that is followed by a camera, which did not see it at all times."""
    rows = [f"{n / 100:g},{1 + n % 3},{2.5 if n % 4 else ''}" for n in range(80)]
    (tmp_path / "a.csv").write_text("\n".join(["time_s,force_n,depth_mm", *rows]))
    imported = import_csv(tmp_path / "a.csv", tmp_path / "a.run", face_mm2=50.0)
    (station,) = open_run(imported.path).recording().stations
    assert station.depth_m == pytest.approx(2.5e-3)
    assert station.hold_depth_m == pytest.approx(2.5e-3)
    assert imported.notes == ()


@pytest.mark.parametrize("station", ["", ",1"])
def test_times_that_go_back_are_put_in_order(station: str, tmp_path: Path) -> None:
    at = [0, 1, 2, 4, 3, 5, 7, 6, 8, 9]
    rows = [f"{n / 100:g},{1 + n}{station}" for n in at]
    (tmp_path / "a.csv").write_text(
        "\n".join(["time_s,force_n" + (",station" if station else ""), *rows])
    )
    imported = import_csv(tmp_path / "a.csv", tmp_path / "a.run", face_mm2=50.0)
    assert imported.notes == ("2 times go back; the samples are put in the order of their times",)
    assert open_run(imported.path).samples()["force"].values.tolist() == [
        1.0 + n for n in range(10)
    ]


def test_stations_places_and_a_reference(tmp_path: Path) -> None:
    rows = [
        f"{n / 100:g},{station + 0.01 * n:g},{10 * station},{5},{station},{np.sin(n):.6f}"
        for station in (3, 1, 7)
        for n in range(20)
    ]
    text = table("time_s, force_n, x_mm, y_mm, station, reference", *rows)
    source = tmp_path / "a.csv.gz"
    source.write_bytes(gzip.compress(text.encode("utf-8-sig")))
    imported = import_csv(source, tmp_path / "a.run", face_mm2=50.0)
    assert imported.notes == ("2 stations did not follow in time; put 1 s apart",)
    assert verify(imported.path).ok
    run = open_run(imported.path)
    stations = run.recording().stations
    assert [s.index + 1 for s in stations] == [1, 3, 7]  # as they are shown
    assert [s.x_m for s in stations] == pytest.approx([0.01, 0.03, 0.07])
    assert stations[0].signal_pa[:3, 0] == pytest.approx(np.array([1.0, 1.01, 1.02]) / 50e-6)
    assert stations[2].reference == pytest.approx(np.sin(np.arange(20)), abs=1e-6)
    for station in stations:
        assert station.time_s - station.time_s[0] == pytest.approx(np.arange(20) / 100)
        assert (station.reference_s == station.time_s).all()


@pytest.mark.parametrize("first", [0, 1])
def test_stations_that_count_from_0_or_from_1_are_the_same(tmp_path: Path, first: int) -> None:
    """What `palpate export` writes counts from 0, people from 1."""
    rows = [f"{n / 100 + s:g},{n},{first + s}" for s in range(3) for n in range(10)]
    path = tmp_path / "rows.csv"
    path.write_text(table("time_s,force_n,station", *rows))
    imported = import_csv(path, tmp_path / "rows.run", face_mm2=50.0)
    assert [s.index for s in open_run(imported.path).recording().stations] == [0, 1, 2]


def test_rows_between_stations_are_left_out(tmp_path: Path) -> None:
    stations = [-1] * 9 + [1] * 20 + [-1] * 5 + [2] * 20
    rows = [f"{n / 100:g},1,{station}" for n, station in enumerate(stations)]
    imported = import_csv(csv(tmp_path / "a.csv", table("time_s,force_n,station", *rows)),
                          tmp_path / "a.run", face_mm2=100.0)  # fmt: skip
    assert imported.notes == ("14 rows between stations (-1) are left out",)
    assert [s.time_s[0] for s in open_run(imported.path).recording().stations] == [0.09, 0.34]
    nowhere = csv(tmp_path / "b.csv", table("time_s,force_n,station", *rows[:9]))
    with pytest.raises(CsvError, match="-1 in every row"):
        import_csv(nowhere, tmp_path / "b.run")


def test_a_new_position_is_a_new_station(tmp_path: Path) -> None:
    rows = [f"{n / 100:g},1,{4 * (n // 25)}" for n in range(100)]
    beside = [f"{row},{3 * (n // 50)}" for n, row in enumerate(rows)]
    for name, lines in (("x_mm", rows), ("x_mm,y_mm", beside)):
        file = csv(tmp_path / "a.csv", table(f"time_s,force_n,{name}", *lines))
        imported = import_csv(file, tmp_path / name)
        assert imported.stations == 4
    run = open_run(tmp_path / "x_mm,y_mm")
    assert run.stations()["y_mm"].to_list() == pytest.approx([0, 0, 3, 3])
    run = open_run(tmp_path / "x_mm")
    assert run.stations()["x_mm"].to_list() == pytest.approx([0, 4, 8, 12])
    assert np.isnan(run.stations()["y_mm"]).all()
    notes = [event.text for event in run.events() if isinstance(event, Note)]
    assert notes == ["the probe's face is not known; 100 mm2 is assumed"]


def test_gaps_doubles_and_uneven_times_are_kept_honestly(tmp_path: Path) -> None:
    rows = ["0,1", "0.01,2", "0.013,", "0.05,NaN", "0.05,4", "0.3,5", "0.31,n/a", "1.7,7", "1.8,8"]
    imported = import_csv(
        csv(tmp_path / "a.csv", table("time_s,pressure_pa", *rows)), tmp_path / "a"
    )
    (station,) = open_run(imported.path).recording().stations
    assert station.time_s.tolist() == [0, 0.01, 0.3, 1.7, 1.8]
    assert station.signal_pa[:, 0].tolist() == [1, 2, 5, 7, 8]
    assert imported.notes == (
        "3 rows without a reading are left out",
        "1 rows with the time of the row before are left out",
    )
    assert verify(imported.path).ok


@pytest.mark.parametrize("text, said", [
    ("", "no table of numbers"),
    ("time_s,force_n\n", "no rows"),
    (table("force_n", "1", "2"), "force_n has no times: say --rate-hz, or --map time_s=COLUMN"),
    (table("time_s,force_mn", "0,1"), "'force_mn': unknown unit; allowed columns"),
    (table("time_ms,force_n", "0,1", "1,2"), "no times: .* it has 'time_ms', 'force_n'"),
    (table("time_s,x_mm", "0,1"), "exactly one of the columns force_n, .* none is there"),
    (table("time_s,force_n,pressure_pa", "0,1,2"), "force_n and pressure_pa are there"),
    (table("time_s,force_n", "0,1", "1,two"), "row 3, column 'force_n': 'two' is not a number"),
    (table("time_s,force_n", "0,1", "1,inf"), "row 3, column 'force_n': 'inf'"),
    (table("time_s,force_n", "0,1", ",2"), "row 3, column 'time_s': every row"),
    (table("time_s,force_n", "0,1", "1,1", "2,1"), "station 1 has only 3 readings, at least 4"),
    (table("station,time_s,force_n", "1,0,1", "2,9,1", "1,1,1"),
     "station 1 has only 1 readings, at least 4 are needed; sort the rows by station"),
    (table("time_s,force_n,station", "0,1,0.5", "1,1,1"), "row 2, column 'station': 0.5"),
    (table("time_s,force_n,station", "0,1,-2", "1,1,1"), "row 2, column 'station': -2"),
    (table("Time (s),Fz", "0,1", "1,2"), r"as --map force_n=COLUMN .*'Time \(s\)', 'Fz'"),
    (table("time_s,force_n", "09:15,1"), "'09:15' is not a number; seconds are wanted"),
    (table("time_s,force_n", "0,01,0,5"), r"write '\.' in numbers|not a number"),
    (table("time_s,force_n,force_n", "0,1,2"), "twice"),
    ("time_s;force_n\n0;1,5\n1;2,5", "station 1 has only 2 readings"),
    (table("time_s,force_n", "0,1,2,3"), "not a table|every row|not a number"),
    (table("time_s,force_n", "0,1", "1,-1e300"),
     r"row 3, column 'force_n': -1e\+300; -1e\+06 to"),
    (table("time_s,pressure_mbar", "0,2e7"),
     r"column 'pressure_mbar': 2e\+07; .* 1e\+07 mbar is"),
    (table("time_s,force_n,x_mm", "0,1,1", "1,1,1e308"),
     r"row 3, column 'x_mm': 1e\+308; .*mm"),
    (table("time_s,force_n,y_mm", "0,1,-4000"), "column 'y_mm': -4000; -3000 to 3000 mm is"),
    (table("time_s,force_n", "0,1", "1e15,1"), r"row 3, column 'time_s': 1e\+15; .* s is"),
    (table("time_s,force_n,reference", "0,1,1e20"), r"row 2, column 'reference': 1e\+20"),
    (table("time_s,force_n,station", *[f"{n},1,{s}" for s in (1, 2, 1) for n in range(5)]),
     "row 12: station 1 again"),
])  # fmt: skip
def test_what_is_wrong_is_said_with_column_and_row(text: str, said: str, tmp_path: Path) -> None:
    source = csv(tmp_path / "bad.csv", text)
    with pytest.raises(CsvError, match=said) as caught:
        import_csv(source, tmp_path / "a.run")
    assert str(source) in str(caught.value)
    assert not (tmp_path / "a.run").exists()


@pytest.mark.parametrize("face_mm2", [1e-300, 0.0, -1.0, 1e7, np.nan])
def test_a_face_that_no_probe_has_is_refused(face_mm2: float, tmp_path: Path) -> None:
    source = csv(tmp_path / "a.csv", table("time_s,force_n", *STEADY))
    with pytest.raises(CsvError, match=r"face_mm2 = .*: must be from 1e-06 to 1e\+06 mm2"):
        import_csv(source, tmp_path / "a.run", face_mm2=face_mm2)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "a.csv.gz").write_bytes(b"no gzip")
    (tmp_path / "b.csv").write_bytes(b"time_s,force_n\n\xff\xfe\n")
    for name, said in (("c.csv", "no such file"), ("a.csv.gz", "cannot be read"), ("b.csv", "UTF")):
        with pytest.raises(CsvError, match=said):
            import_csv(tmp_path / name, tmp_path / "a.run")


def test_a_gzip_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("probe.storage.csv_columns.MAX_BYTES", 10_000)
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"0" * 10**7))
    with pytest.raises(CsvError, match="larger than"):
        import_csv(tmp_path / "a.csv.gz", tmp_path / "a.run")


def test_a_run_is_not_overwritten(tmp_path: Path) -> None:
    source = csv(tmp_path / "a.csv", table("time_s,force_n", *STEADY))
    import_csv(source, tmp_path / "a.run")
    with pytest.raises(StoreError, match="never overwritten"):
        import_csv(source, tmp_path / "a.run")


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.one_of(
        st.binary(max_size=400),
        st.builds(
            lambda header, rows: (header + "\n" + "\n".join(rows)).encode(),
            st.sampled_from(["time_s,force_n", "time_s,pressure_pa,x_mm,station,reference"]),
            st.lists(st.text(alphabet='0123456789.,-+eEnaN "\r\x00;#', max_size=30), max_size=12),
        ),
    )
)
def test_no_bytes_break_the_reader(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    try:
        read = cut(read_csv(tmp_path / "a.csv"))
    except CsvError:
        return
    for press in read.presses:
        assert (np.diff(press.time_s) > 0).all()
        assert np.isfinite(press.signal).all()


@pytest.mark.skipif(not REAL.is_dir(), reason="the real recordings are not on this machine")
def test_real_recordings(tmp_path: Path) -> None:
    meat = pd.read_csv(REAL / "meat_indent_hold.csv")
    meat = meat.rename(columns={"curve": "station", "t_s": "time_s"})
    meat.to_csv(tmp_path / "meat.csv", index=False)
    imported = import_csv(tmp_path / "meat.csv", tmp_path / "meat.run")
    assert (imported.stations, imported.samples) == (30, len(meat))
    assert imported.notes[0] == "columns left out: displacement_mm"
    assert verify(imported.path).ok
    pulse = pd.read_csv(REAL / "radial_pulse.csv.gz")
    pulse["station"] = pulse.groupby("record", sort=False).ngroup()
    pulse = pulse.rename(columns={"t_s": "time_s", "optical": "reference"})
    pulse[pulse["station"] < 3].to_csv(tmp_path / "pulse.csv.gz", index=False)
    imported = import_csv(tmp_path / "pulse.csv.gz", tmp_path / "pulse.run")
    assert verify(imported.path).ok
    recording = open_run(imported.path).recording()
    assert len(recording.stations) == 3
    assert recording.quantum_pa == pytest.approx(10.0)  # 0.1 mbar
    assert len(recording.stations[0].reference) == len(recording.stations[0].time_s)


def test_a_probe_recorded_on_its_way_is_not_taken_for_one_station(tmp_path: Path) -> None:
    """At 100 samples/s and 4 mm/s the rows of a whole row of stations are 0.04 mm apart."""
    still, way = np.zeros(50), 0.04 * np.arange(100)
    x_mm = np.concatenate([4 + still, 4 + way, 8 + still])
    rows = [f"{n / 100:g},{n % 7},{x:.2f}" for n, x in enumerate(x_mm)]
    (tmp_path / "a.csv").write_text("\n".join(["time_s,force_n,x_mm", *rows]))
    with pytest.raises(CsvError, match=r"row 78, column 'x_mm': 5\.04, slowly moved from 4 in"):
        import_csv(tmp_path / "a.csv", tmp_path / "a.run", face_mm2=50.0)
    labelled = [f"{row},{1 + (n >= 100)}" for n, row in enumerate(rows)]
    (tmp_path / "b.csv").write_text("\n".join(["time_s,force_n,x_mm,station", *labelled]))
    assert import_csv(tmp_path / "b.csv", tmp_path / "b.run", face_mm2=50.0).stations == 2


def test_a_slow_recording_is_a_sound_run(tmp_path: Path) -> None:
    rows = [f"{n},{n % 7}" for n in range(10)]
    (tmp_path / "a.csv").write_text("\n".join(["time_s,force_n", *rows]))
    assert verify(import_csv(tmp_path / "a.csv", tmp_path / "a.run", face_mm2=50.0).path).ok


def test_a_file_whose_name_is_no_text_is_imported(tmp_path: Path) -> None:
    source = tmp_path / os.fsdecode(b"\xff.csv")
    source.write_text("\n".join(["time_s,force_n", *(f"{n / 9:g},{n}" for n in range(9))]))
    run = open_run(import_csv(source, tmp_path / "a.run", face_mm2=50.0).path)
    assert run.config["imported"]["file"].endswith("\N{REPLACEMENT CHARACTER}.csv")


def test_a_coarse_sensor_may_read_the_same_again(tmp_path: Path) -> None:
    rows = [f"{t / 100:g},{0.5 + 0.1 * (t % 2):g},4,{n}" for n in range(3) for t in range(40)]
    source = csv(tmp_path / "a.csv", table("time_s,force_n,x_mm,station", *rows))
    assert import_csv(source, tmp_path / "a.run").stations == 3


def test_places_in_metres_and_tables_pasted_twice_are_noted(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    rows = [
        f"{t},{0.5 + 0.01 * rng.standard_normal():.6f},{x}"
        for x in (0.004, 0.008, 0.012)
        for t in 10 * x * 100 + 0.01 * np.arange(40)
    ]
    source = tmp_path / "m.csv"
    source.write_text(table("time_s,force_n,x_mm", *rows))
    imported = import_csv(source, tmp_path / "m.run")
    assert imported.stations == 1
    assert any("3 places span 0.008 mm" in n and "in metres" in n for n in imported.notes)
    named = [f"{row},{n // 40}" for n, row in enumerate(rows)]
    again = [f"{row},{3 + n // 40}" for n, row in enumerate(rows)]
    source.write_text(table("time_s,force_n,x_mm,station", *named, *again))
    imported = import_csv(source, tmp_path / "twice.run")
    assert imported.stations == 3
    assert "stations that repeat others reading by reading are left out: 3" in imported.notes
