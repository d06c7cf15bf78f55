"""The log of a campaign as tables."""

import json
import math
from collections import defaultdict
from pathlib import Path
from typing import Any

from campaign.limits import MAX_FORCE_N

Row = dict[str, Any]
HEAD = (
    "fault", "runs", "completed", "aborted", "faulted", "no answer", "not lifted",
    "most over the limit N", "allowed then N", "longest to rest s", "wrong",
)  # fmt: skip


def print_tables(log: Path) -> int:
    """Print a line per kind, then what was wrong; the number of runs that were wrong."""
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    for clock, count in sorted({(row["clock"], row["faults"]) for row in rows}):
        some = [row for row in rows if (row["clock"], row["faults"]) == (clock, count)]
        print(f"\n{len(some)} runs with {count} fault(s), {clock} clock\n")
        _print_kinds(some)
    wrong = [row for row in rows if row["wrong"]]
    print(f"\n{len(rows)} runs, {len(wrong)} with a violation, "
          f"{sum(bool(row.get('void')) for row in rows)} void")  # fmt: skip
    for row in wrong:
        print("-", row["clock"], row["faults"], row["seed"], " + ".join(row["kinds"]), row["wrong"])
    return len(wrong)


def _print_kinds(rows: list[Row]) -> None:
    by_kind: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        for kind in row["kinds"] or ["none"]:
            by_kind[kind].append(row)
    print(f"| {' | '.join(HEAD)} |")
    print("|---" * len(HEAD) + "|")
    for kind in sorted(by_kind):
        print(_line(kind, by_kind[kind]))


def _line(kind: str, rows: list[Row]) -> str:
    finished = [row.get("finish", "none") for row in rows]
    counts = [finished.count(f) for f in ("completed", "aborted", "faulted", "none")]
    worst = max(rows, key=lambda row: row.get("force_n", 0.0))
    rest = [row["rest_s"] for row in rows if not math.isnan(row.get("rest_s", math.nan))]
    over_n = max(worst.get("force_n", 0.0) - MAX_FORCE_N, 0.0)
    cells = [
        kind, len(rows), *counts, sum(not row.get("up", True) for row in rows), f"{over_n:.2f}",
        f"{worst.get('allowed_n', math.nan) - MAX_FORCE_N:.2f}", f"{max(rest, default=0.0):.2f}",
        sum(bool(row["wrong"]) for row in rows),
    ]  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"
