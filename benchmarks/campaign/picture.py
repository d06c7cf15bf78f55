"""The log of a campaign as a picture, and as a table of a size that can be kept."""

import csv
import json
import math
import subprocess
from collections import defaultdict
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from campaign.limits import MAX_FORCE_N

mpl.use("Agg")

KEPT = (
    "clock", "faults", "seed", "kinds", "status", "finish", "up", "force_n", "allowed_n",
    "depth_mm", "side_n", "rest_s", "latency_s", "late_s", "load", "tries", "at", "wrong",
)  # fmt: skip


def keep(log: Path, table: Path) -> int:
    """Write the runs as CSV, rounded, with the commit that was judged."""
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True
    ).stdout.strip()
    with table.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow((*KEPT, "commit"))
        for row in sorted(rows, key=lambda r: (r["clock"], r["faults"], r["seed"])):
            out.writerow([*(_short(row.get(key)) for key in KEPT), commit])
    return 0


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.4g}"
    return " + ".join(value) if isinstance(value, list) else value


def draw_picture(log: Path, picture: Path) -> int:
    """Left: true force against what the physics of stopping allows. Right: time to rest."""
    from matplotlib import pyplot as plt
    from matplotlib.ticker import FixedLocator, NullFormatter, ScalarFormatter

    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    rows = [row for row in rows if "force_n" in row]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11, 9), width_ratios=(1, 1.1), layout="constrained"
    )
    for clock, colour in (("wall", "tab:blue"), ("arm", "tab:orange"), ("simulated", "0.6")):
        some = [r for r in rows if r["clock"] == clock and math.isfinite(r["allowed_n"])]
        if not some:
            continue
        left.plot([r["allowed_n"] for r in some], [r["force_n"] for r in some], ".", ms=4,
                  color=colour, label=f"{clock} ({len(some)})")  # fmt: skip
    ends = np.array([1.0, 40.0])
    left.plot(ends, ends, "k-", lw=1, label="all that stopping explains")
    left.axhline(MAX_FORCE_N, color="tab:red", lw=1, label=f"the limit, {MAX_FORCE_N} N")
    left.set(xscale="log", yscale="log", xlim=(1.4, 40), ylim=(0.9, 40),
             xlabel="allowed: limit and physics of stopping [N]",
             ylabel="greatest true force [N]")  # fmt: skip
    for axis in (left.xaxis, left.yaxis):
        axis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, 40]))
        axis.set_major_formatter(ScalarFormatter())
        axis.set_minor_formatter(NullFormatter())
    left.legend(fontsize=8)
    by_kind: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        if row["faults"] == 1 and not math.isnan(row["rest_s"]) and row["finish"] != "completed":
            by_kind[row["kinds"][0]].append(row["rest_s"])
    names = sorted(by_kind, key=lambda name: max(by_kind[name]))
    for place, name in enumerate(names):
        right.plot(by_kind[name], [place] * len(by_kind[name]), ".", ms=4, color="tab:blue")
    right.set_yticks(range(len(names)), names, fontsize=7)
    right.set(xlabel="from cause to rest [s]", title="single faults that ended the scan")
    right.set_xlim(left=0)
    figure.savefig(picture, dpi=110)
    return 0
