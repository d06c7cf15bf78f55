"""The runner: picks up where it stopped, one line of JSON a run.

    python -m campaign run --singles 1000 --pairs 300 --log campaign.jsonl --jobs 6
    python -m campaign one --seed 7 --faults 2          one run again, with all it found
    python -m campaign table campaign.jsonl
    python -m campaign picture campaign.jsonl campaign.png
    python -m campaign latency --trials 100

Wall-clock runs mostly wait, so several can run beside each other; each line keeps the machine's
load and the longest time that the truth itself had to wait. A run of which the truth stood still
for longer than `judge.STARVED_S` says nothing and is repeated, at most `TRIES` times.
"""

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

from campaign import latency, simulated
from campaign.faults import ARM_KINDS, BY_NAME, KINDS, SIMULATED, Draw, draw, of_kinds
from campaign.judge import judge, load
from campaign.once import beside, struck_once
from campaign.picture import draw_picture, keep
from campaign.table import print_tables

TRIES = 3
CLOCKS = ("wall", "arm", "simulated")
Task = tuple[str, int, int]  # clock, number of faults, seed


def run_draw(drawn: Draw) -> dict[str, Any]:
    """One run on the wall clock, as a row."""
    tries, void = 0, True
    while void and tries < TRIES:
        tries += 1
        with struck_once(drawn) as (folder, ended):
            verdict = judge(
                drawn,
                load(folder / "truth.npz"),
                status=ended.status,
                answer=ended.answer,
                said=ended.said,
                run=ended.run,
                second=ended.second,
                resumed=ended.resumed,
            )
        void = verdict.void
    words = [line for line in ended.said.splitlines() if line.strip()]
    return {
        "kinds": [fault.kind.name for fault in drawn.faults],
        "tries": tries,
        "seconds": round(ended.seconds, 3),
        "load": round(os.getloadavg()[0], 2),
        "said": words[-3:],
        **verdict.as_row(),
    }


def run_task(task: Task) -> dict[str, Any]:
    """One run of the campaign, as a row."""
    clock, count, seed = task
    try:
        if clock == "wall":
            row = run_draw(draw(seed, count))
        elif clock == "arm":
            row = run_draw(draw(seed, count, ARM_KINDS, arm=True))
        else:
            row = simulated.run_draw(draw(seed, count, SIMULATED))
    except Exception as error:  # noqa: BLE001 - a fault of the campaign is told, not hidden
        row = {"kinds": [], "wrong": [f"the campaign itself: {type(error).__name__}: {error}"]}
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return {"clock": clock, "faults": count, "seed": seed, "at": now, **row}


def tasks(singles: int, pairs: int, first: int) -> list[Task]:
    """Half of each on the wall clock, an eighth of those with the arm; seeds from ``first`` on.

    In such an order that a campaign that is broken off has some of everything.
    """
    parts: list[list[Task]] = []
    for count, total in ((1, singles), (2, pairs)):
        wall = (total + 1) // 2
        arm = wall // 8
        sizes = {"wall": wall - arm, "arm": arm, "simulated": total - wall}
        parts += [[(clock, count, first + k) for k in range(n)] for clock, n in sizes.items()]
    placed = [((n + 0.5) / len(part), task) for part in parts for n, task in enumerate(part)]
    return [task for _, task in sorted(placed)]


def done(log: Path) -> set[Task]:
    """What a log already holds."""
    if not log.exists():
        return set()
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return {(row["clock"], row["faults"], row["seed"]) for row in rows}


def preload() -> None:
    """Import what a scan needs once, for all that are forked from here."""
    import probe.cli.finding
    import probe.cli.progress
    import probe.cli.scan
    import probe.detection.scan
    import probe.guards.guard_process
    import probe.scan.resume
    import probe.scan.session

    del probe


def run(arguments: argparse.Namespace) -> int:
    """Every run that the log does not hold yet; the number of violations."""
    preload()
    before = done(arguments.log)
    every = tasks(arguments.singles, arguments.pairs, arguments.first)
    left = [task for task in every if task not in before]
    if arguments.clock:
        left = [task for task in left if task[0] == arguments.clock]
    wrong, until_s = 0, time.monotonic() + 60.0 * arguments.minutes
    with beside(arguments.jobs) as pool, arguments.log.open("a") as log:
        for row in _in_time(pool, left, until_s, arguments.jobs):
            log.write(json.dumps(row) + "\n")
            log.flush()
            if row["wrong"]:
                wrong += 1
                print(row["clock"], row["faults"], row["seed"], row["kinds"], row["wrong"])
    return wrong


def _in_time(
    pool: ProcessPoolExecutor, left: list[Task], until_s: float, jobs: int
) -> Iterator[dict[str, Any]]:
    """The rows of the tasks that begin before ``until_s``, as they end."""
    waiting: set[Future[dict[str, Any]]] = set()
    todo = iter(left)
    while True:
        if time.monotonic() < until_s:
            waiting |= {pool.submit(run_task, task) for task in islice(todo, jobs - len(waiting))}
        if not waiting:
            return
        ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
        yield from (future.result() for future in ended)


def one(arguments: argparse.Namespace) -> int:
    """One run, told in full."""
    import numpy as np

    preload()
    arm = arguments.clock == "arm"
    if arguments.kinds:
        kinds = [BY_NAME[name] for name in arguments.kinds]
        rng = np.random.default_rng(arguments.seed)
        drawn = of_kinds(arguments.seed, kinds, rng, arm=arm)
    else:
        kinds_of = {"wall": KINDS, "arm": ARM_KINDS, "simulated": SIMULATED}[arguments.clock]
        drawn = draw(arguments.seed, arguments.faults, kinds_of, arm=arm)
    print(drawn)
    made = simulated.run_draw if arguments.clock == "simulated" else run_draw
    row = made(drawn)
    print(json.dumps(row, indent=2))
    return len(row["wrong"])


def measure_latency(arguments: argparse.Namespace) -> int:
    """Guard latency under each condition."""
    preload()
    return latency.run(arguments.trials, arguments.jobs, arguments.log)


def main() -> int:
    """Read the command line; 0 if nothing was wrong."""
    parser = argparse.ArgumentParser(prog="campaign", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    commands = parser.add_subparsers(required=True)
    many = commands.add_parser("run")
    many.add_argument("--singles", type=int, default=1000)
    many.add_argument("--pairs", type=int, default=300)
    many.add_argument("--first", type=int, default=0, help="seed: faults that no one has met")
    many.add_argument("--log", type=Path, default=Path("campaign.jsonl"))
    many.add_argument("--jobs", type=int, default=4)
    many.add_argument("--clock", choices=CLOCKS)
    many.add_argument("--minutes", type=float, default=math.inf, help="begin none after that")
    many.set_defaults(do=run)
    single = commands.add_parser("one")
    single.add_argument("kinds", nargs="*", help="in place of what the seed draws")
    single.add_argument("--seed", type=int, default=0)
    single.add_argument("--faults", type=int, default=1)
    single.add_argument("--clock", choices=CLOCKS, default="wall")
    single.set_defaults(do=one)
    table = commands.add_parser("table")
    table.add_argument("log", type=Path)
    table.set_defaults(do=lambda given: print_tables(given.log))
    kept = commands.add_parser("keep", help="the log as CSV")
    kept.add_argument("log", type=Path)
    kept.add_argument("csv", type=Path)
    kept.set_defaults(do=lambda given: keep(given.log, given.csv))
    drawn = commands.add_parser("picture")
    drawn.add_argument("log", type=Path)
    drawn.add_argument("png", type=Path)
    drawn.set_defaults(do=lambda given: draw_picture(given.log, given.png))
    lag = commands.add_parser("latency")
    lag.add_argument("--trials", type=int, default=100)
    lag.add_argument("--log", type=Path, default=Path("latency.csv"))
    lag.add_argument("--jobs", type=int, default=3)
    lag.set_defaults(do=measure_latency)
    arguments = parser.parse_args()
    return min(int(arguments.do(arguments)), 1)


if __name__ == "__main__":
    sys.exit(main())
