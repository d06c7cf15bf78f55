"""Fault campaign: random faults at random instants, every run stored, checked, resumed, compared.

    python benchmarks/faults.py [RUNS] [KILLS] [FIRST_SEED]

RUNS (500) scans of five stations around an artery are struck once each by a fault drawn from the
seed: devices, users, the world, the disk, observers, the clock, the processes. KILLS (100) more
are killed with `kill -9` at a random instant and resumed. `fault_runs` and `fault_kills` say what
is checked. Exit status 1 if any run was wrong.
"""

import sys
import time
from collections import Counter, defaultdict
from collections.abc import Sequence

import numpy as np
from fault_kills import KILLS, kill_one
from fault_runs import KINDS, REAL_TIME_FAULTS, Outcome, run_one

ENDS = ("completed", "aborted", "faulted", "broken off", "not begun")


def strike(seed: int) -> Outcome:
    """One run with a fault drawn from the seed; those in real time half as often."""
    kinds = (*KINDS, *KILLS)
    weights = np.array([0.5 if kind in REAL_TIME_FAULTS else 1.0 for kind in kinds])
    rng = np.random.default_rng([seed, 1])
    kind = str(rng.choice(kinds, p=weights / weights.sum()))
    return kill_one(seed, kind) if kind in KILLS else run_one(seed, kind)


def table(outcomes: Sequence[Outcome]) -> str:
    """One row per kind of fault; force and depth are the phantom's truth."""
    rows: dict[str, list[Outcome]] = defaultdict(list)
    for one in outcomes:
        rows[one.kind].append(one)
    lines = [
        "| fault | runs | " + " | ".join(ENDS) + " | max force N | max depth mm "
        "| longest silence s | wrong |",
        "|---" * (len(ENDS) + 6) + "|",
    ]
    for kind in (*KINDS, *KILLS):
        if found := rows[kind]:
            ends = Counter(str(one.finish) for one in found)
            force = max(one.force_n for one in found)
            depth = max(one.depth_m for one in found)
            truth = [f"{force:.3f}", f"{1e3 * depth:.3f}"]
            cells = [
                kind,
                str(len(found)),
                *[str(ends[end]) for end in ENDS],
                *["-" if cell == "nan" else cell for cell in truth],
                f"{max(one.hang_s for one in found):.2f}",
                str(sum(bool(one.wrong) for one in found)),
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def failures(outcomes: Sequence[Outcome], first: int) -> list[str]:
    """What was wrong, with the seed that shows it again."""
    return [
        f"seed {seed}: {one.kind} at {one.at_s:.3f} s: {wrong}"
        for seed, one in enumerate(outcomes, start=first)
        for wrong in one.wrong
    ]


def main() -> None:
    """Run the campaign and print it."""
    given = [int(argument) for argument in sys.argv[1:]]
    runs, kills, first = (*given, *(500, 100, 1)[len(given) :])
    began_s = time.perf_counter()
    struck = [strike(seed) for seed in range(first, first + runs)]
    print(f"{runs} runs, seeds {first} to {first + runs - 1}; limits 1.6 N, 3 mm\n")
    print(table(struck))
    killed = [kill_one(seed, "kill -9") for seed in range(first, first + kills)]
    left = Counter(one.stations for one in killed if one.finish == "broken off")
    print(f"\n{kills} times kill -9 and resume; broken off with 0 to 5 stations complete: ", end="")
    print(*[left[n] for n in range(6)], sep=", ")
    wrong = failures(struck, first) + failures(killed, first)
    print(*wrong, f"{len(wrong)} violations; {time.perf_counter() - began_s:.0f} s", sep="\n")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
