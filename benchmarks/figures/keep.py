"""One stored result: its data, and by what, of which code, where and when it was measured."""

import json
import os
import platform
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "docs" / "figures"
MEASURED = ("palpate", "probe", "drivers", "sim_backend", "calibration", "benchmarks")


@dataclass(frozen=True)
class Figure:
    """``measure`` gives the data, as JSON knows it: numbers by name, and ``table`` as rows of text.

    ``minutes`` of a processor that it takes, about.
    """

    name: str
    minutes: float
    measure: Callable[[], dict[str, Any]]


def keep(figure: Figure) -> Path:
    """Measure, and write ``docs/figures/NAME.json``."""
    load = os.getloadavg()[0]
    commit = _git("rev-parse", "--short", "HEAD")
    changed = bool(_git("status", "--porcelain", "--", *MEASURED))
    data = figure.measure()  # whatever is checked out meanwhile
    path = KEPT / f"{figure.name}.json"
    kept = {
        "command": f"make figures ONLY={figure.name}",
        "commit": commit,
        "changed": changed,
        "machine": f"{os.cpu_count()} processors, {platform.machine()}, {platform.system()}, "
        f"Python {platform.python_version()}, load {load:.0f} before",
        "date": datetime.now(UTC).date().isoformat(),
        "data": data,
    }
    path.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()
