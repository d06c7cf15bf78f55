"""What every benchmark is run by: a command line, and results that grow row by row.

A benchmark that was broken off goes on where it stopped.
"""

import argparse
import csv
import inspect
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from multiprocessing import get_context
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
    jobs: Iterable[tuple[object, ...]], judge: Callable[..., Row | None], workers: int = 1,
) -> list[dict[str, str]]:  # fmt: skip
    """Append ``judge(*job)`` to the CSV ``path`` for each job that it does not hold yet; all rows.

    ``keys`` name a job's parts, ``answers`` what is judged; a row also gets the commit and the
    date. A job that is judged None is kept without answers, so that it is not asked again. Several
    ``workers`` are forks that ask beside each other.
    """
    have = {tuple(row[key] for key in keys) for row in read(path)}
    origin = {"commit": commit(), "date": datetime.now(UTC).date().isoformat()}
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, [*keys, *answers, *origin])
        if not have:
            writer.writeheader()
        missing = (job for job in jobs if tuple(str(part) for part in job) not in have)
        for job, row in _judged(missing, judge, workers):
            writer.writerow(dict(zip(keys, job, strict=True)) | dict(row or {}) | origin)
            file.flush()
    return read(path)


def _judged(
    jobs: Iterable[tuple[object, ...]], judge: Callable[..., Row | None], workers: int
) -> Iterator[tuple[tuple[object, ...], Row | None]]:
    if workers == 1:
        yield from ((job, judge(*job)) for job in jobs)
        return
    with ProcessPoolExecutor(workers, get_context("fork")) as pool:
        begun = {pool.submit(judge, *job): job for job in jobs}
        yield from ((begun[answer], answer.result()) for answer in as_completed(begun))


def read(path: Path) -> list[dict[str, str]]:
    """The rows so far."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def run(main: Callable[..., int | None]) -> None:
    """Call ``main`` with the arguments of the command line, and exit by what it returns.

    Each of its parameters is an argument of the parameter's type, as many as are given of a
    ``*parameter``; what has a default need not be given.
    """
    parser = argparse.ArgumentParser(
        description=inspect.getdoc(inspect.getmodule(main)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for one in inspect.signature(main, eval_str=True).parameters.values():
        needed = one.default is one.empty
        nargs = "*" if one.kind is one.VAR_POSITIONAL else None if needed else "?"
        default = None if needed else one.default
        parser.add_argument(one.name, type=one.annotation, nargs=nargs, default=default)
    values = vars(parser.parse_args()).values()
    sys.exit(main(*(word for v in values for word in (v if isinstance(v, list) else [v]))))


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
