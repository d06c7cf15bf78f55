"""A table of raw readings (CSV) as it is in its file: which row is wrong if it is none."""

import csv
import re
import warnings
from pathlib import Path

from calibration.errors import CalibrationError
from drivers.core.extras import needs

with needs("data", "palpate calibrate"):
    import pandas as pd

MAX_ROWS = 5_000_000
SEMICOLONS = (
    "its columns are separated by semicolons; save it with commas, and with points in its numbers"
)
WHOLE = re.compile(r"[-+]?\d+")


def read_table(path: Path) -> pd.DataFrame:
    """A CSV's columns by their names; what follows a # is a remark, as are empty lines.

    Raises `CalibrationError` naming the file, and the row (1 is the first below the names) that has
    more values than there are names.
    """
    try:
        with warnings.catch_warnings():
            # said where the first row is longer than the header: the rest would be cut off
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                path, nrows=MAX_ROWS, comment="#", skipinitialspace=True, index_col=False
            )
    except (ValueError, pd.errors.ParserWarning) as error:
        why = _too_long(path) or f"not a CSV table ({error})"
        raise CalibrationError(f"{path}: {why}") from None
    if len(table.columns) == 1 and ";" in str(table.columns[0]):
        raise CalibrationError(f"{path}: {SEMICOLONS}")
    if not len(table):
        raise CalibrationError(f"{path}: no rows below the column names")
    return table.rename(columns=lambda name: str(name).strip())


def _too_long(path: Path) -> str | None:
    """Which row has more values than the header has names; None if none has."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
            lines = csv.reader((line.partition("#")[0] for line in file), skipinitialspace=True)
            rows = (row for row in lines if row not in ([], [""]))
            names = next(rows, [])
            for number, row in enumerate(rows, 1):
                if len(row) > len(names):
                    return _why_too_long(number, row, names)
    except csv.Error:
        pass
    return None


def _why_too_long(number: int, row: list[str], names: list[str]) -> str:
    if len(names) == 1 and ";" in names[0]:  # and each decimal comma parts a number
        return SEMICOLONS
    said = (
        f"row {number} has {len(row)} values, and the header {len(names)} names "
        f"({', '.join(name.strip() for name in names)})"
    )
    values = [value.strip() for value in row]
    if not values[-1]:
        return f"{said}: take the comma from its end"
    if all(WHOLE.fullmatch(value) for value in values):
        return f"{said}: are these decimal commas? Write numbers with points, as 0.5"
    return f"{said}: name every column, and write numbers with points, as 0.5"
