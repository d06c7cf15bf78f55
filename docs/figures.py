"""The stored results in ``docs/figures``, put into the pages when the site is built.

A page writes ``{{ figure("fleet.scan_s", ".2f") }}`` for a number, ``{{ table("paper") }}`` for a
table and ``{{ measured("paper") }}`` for by what, of which code, when and where it was measured. A
name that no stored result has stops the build. `make figures` measures them anew. Of what
benchmarks keep case by case in ``docs/results``, ``{{ counts("six-scenes", "sensor", "scene") }}``
is a table of the answers, ``{{ greatest("device-faults", "device", "ended_s") }}`` one of how many
cases there are and of the greatest values, ``{{ spread("windows", "what", "ms") }}`` one of median,
95th percentile and greatest value, ``{{ rows("corruption", "sensor", "lost") }}`` one of every case
and some of its columns, and ``{{ kept("six-scenes") }}`` says of which code.
"""

import csv
import json
import re
from collections import Counter
from functools import lru_cache
from math import ceil
from pathlib import Path
from statistics import median
from typing import Any

STORED, RESULTS = Path(__file__).with_name("figures"), Path(__file__).with_name("results")
MACRO = re.compile(r"\{\{\s*(\w+)\((.*?)\)\s*\}\}")
WORDS = re.compile(r'"([^"]*)"')


class NoFigure(KeyError):
    """A page names a figure that was never measured."""

    def __str__(self) -> str:
        return str(self.args[0])


@lru_cache
def stored(name: str) -> dict[str, Any]:
    """One result with its commit, machine and date. Raises `NoFigure`."""
    path = STORED / f"{name}.json"
    if not path.is_file():
        known = ", ".join(sorted(one.stem for one in STORED.glob("*.json")))
        raise NoFigure(f"{name}: no stored result of that name; there are {known}")
    result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return result


def figure(where: str, spec: str = ".3g") -> str:
    """A number: ``result.key.key``, printed by ``spec``; a whole number as it is."""
    name, *keys = where.split(".")
    value: Any = stored(name)["data"]
    for key in keys:
        try:
            value = value[int(key) if isinstance(value, list) else key]
        except (KeyError, IndexError, ValueError, TypeError):
            raise NoFigure(f"{where}: {name} has no {key}") from None
    if isinstance(value, int) and spec == ".3g":
        return f"{value:,}"
    return format(value, spec) if isinstance(value, int | float) else str(value)


def table(name: str, part: str = "") -> str:
    """A table of text, ``table`` or ``PART_table`` of the result."""
    data, begins = stored(name)["data"], f"{part}_" if part else ""
    try:
        rows = [data[f"{begins}head"], *data[f"{begins}table"]]
    except KeyError as missing:
        raise NoFigure(f"{name}: it has no {missing}") from None
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]])


def measured(name: str) -> str:
    """By what, of which code, when and where."""
    one = stored(name)
    changed = " with changes" if one["changed"] else ""
    return (
        f"Measured on {one['date']} at commit {one['commit']}{changed} by `{one['command']}` "
        f"({one['machine']})."
    )


@lru_cache
def cases(name: str) -> list[dict[str, str]]:
    """The cases that a benchmark kept and judged. Raises `NoFigure`."""
    path = RESULTS / f"{name}.csv"
    if not path.is_file():
        raise NoFigure(f"{name}: no kept result of that name in {RESULTS}")
    with path.open(newline="", encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row.get("found", "judged")]


def counts(name: str, down: str, across: str) -> str:
    """What was found how often, most often first: a row for each value of the column ``down``, a
    cell for each of ``across``."""
    try:
        cells = [(row[down], row[across], row["found"]) for row in cases(name)]
    except KeyError as missing:
        raise NoFigure(f"{name}: it has no column {missing}") from None
    head = list(dict.fromkeys(cell[1] for cell in cells))
    lines = [f"| {down} | " + " | ".join(head) + " |", "|---" * (len(head) + 1) + "|"]
    for one in dict.fromkeys(cell[0] for cell in cells):
        said = [Counter(f for d, a, f in cells if (d, a) == (one, other)) for other in head]
        each = [", ".join(f"{n} {what}" for what, n in some.most_common()) for some in said]
        lines.append(f"| {one} | " + " | ".join(each) + " |")
    return "\n".join(lines)


def greatest(name: str, down: str, *columns: str) -> str:
    """A row for each value of the column ``down``: how many cases, and the greatest number in each
    of ``columns``."""
    head = [down, "cases", *(f"greatest {one}" for one in columns)]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    try:
        for one in dict.fromkeys(row[down] for row in cases(name)):
            rows = [row for row in cases(name) if row[down] == one]
            most = [f"{max(float(row[column]) for row in rows):.3g}" for column in columns]
            lines.append("| " + " | ".join([one, str(len(rows)), *most]) + " |")
    except KeyError as missing:
        raise NoFigure(f"{name}: it has no column {missing}") from None
    return "\n".join(lines)


def spread(name: str, down: str, column: str) -> str:
    """A row for each value of the column ``down``: how many cases, and median, 95th percentile and
    greatest number in ``column``."""
    lines = [f"| {down} | cases | median {column} | 95th percentile | greatest |", "|---" * 5 + "|"]
    try:
        for one in dict.fromkeys(row[down] for row in cases(name)):
            values = sorted(float(row[column]) for row in cases(name) if row[down] == one)
            some = (median(values), values[ceil(0.95 * len(values)) - 1], values[-1])
            shown = (f"{value:.2g}" if value < 10 else f"{value:.0f}" for value in some)
            lines.append("| " + " | ".join([one, str(len(values)), *shown]) + " |")
    except KeyError as missing:
        raise NoFigure(f"{name}: it has no column {missing}") from None
    return "\n".join(lines)


def rows(name: str, *columns: str) -> str:
    """Every case, and these of its columns."""
    lines = ["| " + " | ".join(columns) + " |", "|---" * len(columns) + "|"]
    try:
        lines += ["| " + " | ".join(row[one] for one in columns) + " |" for row in cases(name)]
    except KeyError as missing:
        raise NoFigure(f"{name}: it has no column {missing}") from None
    return "\n".join(lines)


def kept(name: str) -> str:
    """How many cases, of which code, when."""
    every = cases(name)
    commits, dates = (", ".join(sorted({row[key] for row in every})) for key in ("commit", "date"))
    return f"{len(every):,} cases of {commits} ({dates})"


KINDS = {
    "figure": figure, "table": table, "measured": measured, "counts": counts,
    "greatest": greatest, "spread": spread, "rows": rows, "kept": kept,
}  # fmt: skip


def filled(markdown: str) -> str:
    """A page with its figures. Raises `NoFigure`."""

    def one(found: re.Match[str]) -> str:
        if found[1] not in KINDS:
            raise NoFigure(f"{found[0]}: {found[1]} is none of {', '.join(KINDS)}")
        return KINDS[found[1]](*WORDS.findall(found[2]))

    return MACRO.sub(one, markdown)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """MkDocs' hook: each page, before it is rendered."""
    return filled(markdown)
