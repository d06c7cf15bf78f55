"""Tables in text as instruments export them: lines of a header, names, perhaps units, then numbers.

Columns are separated by tab, ``;``, ``,`` or spaces; a comma may be the decimal mark.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drivers.core.arrays import Array
from drivers.core.units import SI
from probe.storage.csv_columns import text_of
from probe.storage.import_columns import Column, Recording
from probe.storage.import_table import CsvError

MARKS = ("\t", ";", ",", "|", None)  # None: spaces
LOOKED_AT = 400  # lines, from which the table's form is known
MAX_LINE_BYTES = 1 << 16  # of an array of 5,000 taxels
ROWS = 10_000  # made numbers at a time
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")
KNOWN = (
    (r"^LabVIEW Measurement", "a LabVIEW measurement file (.lvm); where it has no X_Value, its "
     "Delta_X is 1 / --rate-hz"),
    (r"\bactual_TCP_force_2\b", "a UR's own record: --map time_s=timestamp --map "
     "force_n=actual_TCP_force_2 (or its minus)"),
)  # fmt: skip
"""What shows in a file's first lines that it is of a program, and what to do."""


class _Form(NamedTuple):
    """How a table is written: the mark between cells, the decimal mark, which cells are numbers."""

    mark: str | None
    comma: bool
    numeric: tuple[bool, ...]
    score: float


def read_text(source: Path) -> Recording:
    """The largest table of numbers in it. Raises `CsvError`."""
    text = _decoded(source)
    lines = text.splitlines()
    notes = [text for sign, text in KNOWN if re.search(sign, "\n".join(lines[:50]), re.MULTILINE)]
    form = max((_form(lines, mark) for mark in MARKS), key=lambda form: form.score)
    if not form.score:
        raise CsvError("no table of numbers is in it" + "".join(f"; it is {n}" for n in notes))
    notes = [f"this is {note}" for note in notes]
    width = len(form.numeric)
    first = next(n for n, line in enumerate(lines) if _is_row(_cells(line, form.mark), form))
    names, units = _heads([_cells(line, form.mark) for line in lines[:first]], width)
    parts: list[list[Sequence[str]]] = [[]]
    broken = 0
    for line in lines[first:]:
        cells = _cells(line, form.mark)
        if len(cells) >= width:
            if len(parts[-1]) == ROWS:
                parts.append([])
            parts[-1].append(cells)
        elif any(cells):
            broken += 1
    columns = {
        name: _column([[row[n] for row in part] for part in parts], form.comma, units[n])
        for n, name in enumerate(names)
    }
    if broken:
        notes.append(f"{broken} lines are not whole and are left out")
    elif not text.endswith(("\n", "\r")):
        notes.append("the last line has no end: it may be cut off")
    numbers = [column.values for column in columns.values() if not column.words]
    if odd := int(sum(np.isnan(values).sum() for values in numbers)):
        notes.append(f"{odd} cells are empty or no numbers, and count as nothing")
    return Recording(columns, tuple(notes))


def _column(parts: list[list[str]], comma: bool, unit: str) -> Column:
    """Cells as numbers, or as words where none is one."""
    values = np.concatenate([_numbers(part, comma) for part in parts])
    if np.isfinite(values).any():
        return Column(values, None, unit)
    numbers: dict[str, int] = {}
    words = [numbers.setdefault(cell, len(numbers) + 1) for part in parts for cell in part]
    return Column(np.array(words, np.float64), words=True)


def _decoded(source: Path) -> str:
    """As UTF-8 or UTF-16, or as Windows of western Europe writes."""
    with text_of(source, MAX_LINE_BYTES) as text:
        content = io.BufferedReader(text, 2**16).read()
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", "replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def _form(lines: list[str], mark: str | None) -> _Form:
    """The most common kind of row under ``mark``, and how many numbers it explains."""
    best = _Form(mark, False, (), 0)
    some = [_cells(line, mark) for line in (*lines[:LOOKED_AT], *lines[LOOKED_AT:][-LOOKED_AT:])]
    for comma in (False, True) if mark != "," else (False,):
        kinds = Counter(
            tuple(_is_number(cell, comma) for cell in cells) for cells in some if any(cells)
        )
        for numeric, count in kinds.items():
            score = count * sum(numeric) ** 2 / len(numeric)  # words speak against
            if count > 1 and score > best.score:
                best = _Form(mark, comma, numeric, score)
    return best


def _is_row(cells: list[str], form: _Form) -> bool:
    """Whether its numbers are where the table has them; cells may be empty."""
    if len(cells) < len(form.numeric):
        return False
    there = [
        _is_number(cell, form.comma)
        for cell, numeric in zip(cells, form.numeric, strict=False)
        if numeric and cell
    ]
    return bool(there) and all(there)


def _heads(above: list[list[str]], width: int) -> tuple[list[str], list[str]]:
    """Names and units (empty: unknown) of the columns, from the lines above them."""
    near = [cells[:width] for cells in above[-2:] if len(cells) >= width]
    units = [""] * width
    if near and len(near) == len(above[-2:]) and all(_is_unit(c) for c in near[-1] if c):
        units = [cell.strip("[]()") for cell in near.pop()]
    elif above and len(above[-1]) < width:
        near = []
    names = [name or str(n) for n, name in enumerate(near[-1])] if near else map(str, range(width))
    return _different(list(names)), units


def _different(names: list[str]) -> list[str]:
    return [f"{name}#{n}" if names.count(name) > 1 else name for n, name in enumerate(names)]


def _cells(line: str, mark: str | None) -> list[str]:
    if not line.strip():
        return []
    if mark is None:
        return re.split(r"\s+(?![\[(])", line.strip())  # "Zeit [s]" is one name
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=mark), [])]
    return [cell.strip() for cell in line.split(mark)]


def _is_unit(cell: str) -> bool:
    return cell.strip("[]()") in {"%", "V", "-", "1", "°", *SI}


def _is_number(cell: str, comma: bool) -> bool:
    return NUMBER.match(cell.replace(",", ".") if comma else cell) is not None


def _numbers(cells: list[str], comma: bool) -> Array:
    """Cells as numbers, moments as seconds, NaN for words."""
    plain = [cell.replace(",", ".") for cell in cells] if comma else cells
    try:
        return np.array(plain, np.str_).astype(np.float64)
    except ValueError:
        pass
    numbers = np.array([float(c) if NUMBER.match(c) else np.nan for c in plain], np.float64)
    if np.isfinite(numbers).any():
        return numbers
    try:
        return np.array([datetime.fromisoformat(cell).timestamp() for cell in plain])
    except (ValueError, OverflowError):
        return numbers
