"""Results that grow row by row: a benchmark that was broken off goes on where it stopped."""

import csv
import subprocess
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from scipy.stats import beta

Row = Mapping[str, object]
ROOT = Path(__file__).parents[1]


def commit() -> str:
    """The present one; with a plus where the work tree differs from it."""
    done = subprocess.run(
        ["git", "describe", "--always", "--dirty=+", "--exclude=*"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout.strip() or "unknown"


def fill(
    path: Path, keys: tuple[str, ...], answers: tuple[str, ...],
    jobs: Iterable[tuple[object, ...]], judge: Callable[..., Row | None],
) -> None:  # fmt: skip
    """Append ``judge(*job)`` to the CSV ``path`` for each job that it does not hold yet.

    ``keys`` name a job's parts, ``answers`` what is judged; a row also gets the commit and the
    date. A job that is judged None is kept without answers, so that it is not asked again.
    """
    have = {tuple(row[key] for key in keys) for row in read(path)}
    origin = {"commit": commit(), "date": datetime.now(UTC).date().isoformat()}
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, [*keys, *answers, *origin])
        if not have:
            writer.writeheader()
        for job in jobs:
            if tuple(str(part) for part in job) in have:
                continue
            writer.writerow(dict(zip(keys, job, strict=True)) | dict(judge(*job) or {}) | origin)
            file.flush()


def read(path: Path) -> list[dict[str, str]]:
    """The rows so far."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def interval(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a share (Clopper & Pearson 1934)."""
    low = 0.0 if count == 0 else float(beta.ppf(0.025, count, of - count + 1))
    high = 1.0 if count == of else float(beta.ppf(0.975, count + 1, of - count))
    return low, high


def exact(count: int, of: int) -> str:
    """A share in per cent with its 95 % interval."""
    if not of:
        return "none"
    low, high = interval(count, of)
    return f"{100 * count / of:.1f} ({100 * low:.1f} to {100 * high:.1f})"
