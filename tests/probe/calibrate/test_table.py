"""Tables of raw readings: what shifts their columns is refused, what is of no use is left out."""

import re
from pathlib import Path

import pytest
from paths import ROOT

from calibration.errors import CalibrationError
from probe.calibrate.fits import Choices, fit_measurements
from probe.calibrate.measurements import COLUMNS, read
from probe.calibrate.table import read_table
from probe.cli import main

ROWS = [(0.211, 0), (1.508, 1), (2.812, 2), (4.109, 3), (2.81, 2), (1.51, 1), (0.209, 0)]


def written(path: Path, head: str, rows: list[str]) -> Path:
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


@pytest.mark.parametrize("head, rows, reported", [
    ("depth_mm,force_n", ["0,0.1,0.2", "1,0.2,0.3"],
     r"t.csv: row 1 has 3 values, and the header 2 names \(depth_mm, force_n\): name every"),
    ("depth_mm,force_n", ["0,0.1", "1,0.2", "2,0.3,0.4"], "t.csv: row 3 has 3 values"),
    ("depth_mm,force_n", ["0,211,0", "1,508,1"], "row 1 .*: are these decimal commas"),
    ("depth_mm,force_n", ["0,1", "# a remark", "", "1,2,"], "row 2 .*: take the comma from"),
    ("depth_mm,force_n", [], "t.csv: no rows below the column names"),
])  # fmt: skip
def test_a_row_that_is_longer_than_the_header_is_refused(
    tmp_path: Path, head: str, rows: list[str], reported: str
) -> None:
    """pandas took the first value for the row's name, and each column for the one beside it."""
    with pytest.raises(CalibrationError, match=reported):
        read(written(tmp_path / "t.csv", head, rows), "compliance")


def test_a_comma_at_the_end_of_every_row_is_none(tmp_path: Path) -> None:
    for head in ("raw,load_n", "raw,load_n,"):
        table = written(tmp_path / "t.csv", head, [f"{raw},{load}," for raw, load in ROWS])
        measured = read(table, "force")
        assert measured.columns("raw", "load_n").tolist() == [list(row) for row in ROWS]
        assert measured.left_out == ()


@pytest.mark.parametrize("kind", COLUMNS)
def test_a_header_alone_is_no_table(kind: str, tmp_path: Path) -> None:
    table = written(tmp_path / "t.csv", "time_s,raw,load_n,depth_mm,force_n,x_mm,y_mm,z_mm", [])
    assert main(["calibrate", kind, str(table), "--device", "d"]) == 2
    with pytest.raises(CalibrationError, match="no rows below the column names"):
        read_table(table)


def test_a_column_without_a_number_is_named(tmp_path: Path) -> None:
    table = written(tmp_path / "t.csv", "raw,load_n", ["1,", "2,"])
    with pytest.raises(CalibrationError, match=r"t\.csv: column load_n is empty"):
        fit_measurements("force", read(table, "force", "d"), Choices())


def test_words_beside_the_readings_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"2026-01-01T00:00:0{n},{raw},{load},ok" for n, (raw, load) in enumerate(ROWS)]
    table = written(tmp_path / "t.csv", "time,raw,load_n,note", rows)
    out = ["--device", "cell", "--out", str(tmp_path / "c.json")]
    assert main(["calibrate", "force", str(table), *out]) == 0
    said = capsys.readouterr()
    assert "columns left out: time, note" in said.err
    assert "1.30004 raw/N" in said.out
    with pytest.raises(CalibrationError, match="value is missing; it has time, raw, load_n, note"):
        read(table, "tare").column("value")


@pytest.mark.parametrize("kind", COLUMNS)
def test_every_kind_takes_the_columns_that_its_page_names(kind: str, tmp_path: Path) -> None:
    """A column that was left out by mistake would be missing from the fit without a word."""
    page = (ROOT / "docs" / "how-to" / "calibration.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{kind}` |")]
    said = re.findall(r"`([a-z0-9_]+)`", row.split("|")[3])
    names = [one for one in said if "_" in one or one in ("raw", "value", "reference", "pressure")]
    table = written(tmp_path / "t.csv", ",".join(names), [",".join("1" for _ in names)])
    assert names
    assert read(table, kind, "d").left_out == ()


def test_a_table_that_was_pasted_twice_counts_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Axes' intervals held in 40 to 53 % where each row was there five times."""
    points = [(0, 0, 0), (50, 0, 1), (0, 50, 2), (50, 50, 30), (20, 10, 40), (10, 30, 20)]
    off = (0.01, -0.02, 0.015, -0.01, 0.02, -0.015)
    lines = [
        f"{x},{y},{z},{1.01 * x + e},{y - e},{z + e}"
        for (x, y, z), e in zip(points, off, strict=True)
    ]
    head = "x_mm,y_mm,z_mm,true_x_mm,true_y_mm,true_z_mm"
    once = read(written(tmp_path / "once.csv", head, lines), "axes", "d")
    five = read(written(tmp_path / "five.csv", head, 5 * lines), "axes", "d")
    assert five.copies == 5
    assert fit_measurements("axes", five, Choices()).fit.interval() == pytest.approx(
        fit_measurements("axes", once, Choices()).fit.interval()
    )
    out = ["--device", "d", "--out", str(tmp_path / "c.json")]
    assert main(["calibrate", "axes", str(tmp_path / "five.csv"), *out]) == 0
    assert "every row is there 5 times: each counts once" in capsys.readouterr().err
    some = read(written(tmp_path / "some.csv", head, [*lines, lines[0]]), "axes", "d")
    assert some.copies == 1
