"""How true are a touch table's forces? Presses that it was not trained on, at other depths.

    python benchmarks/touch.py [PRESSES]

Each is solved by the finite elements at three depths between those of the training, over a random
body in a random block, and compared with the table that comes with palpate.
"""

from pathlib import Path

import numpy as np
from kept import ROOT, Row, exact, fill, read, run

import palpate
from sim_backend.models import train_touch
from sim_backend.touch.kept import table_for
from sim_backend.touch.kinds import KINDS

KEPT = ROOT / "docs/results/touch.csv"
FIRST = 5000  # a table is trained on the presses from 0 on
DEPTHS = (0.1, 0.22, 0.4)
PARTS = ("force", "pulse")
WHAT = ("true", "off", "stated", "off_pct")
ANSWERS = tuple(f"{part}_{what}" for part in PARTS for what in WHAT)


def pressed(kind_name: str, number: int, depth: float) -> Row:
    """Force and pulse over the bare block's force: what the finite elements say, what the table is
    off by, and what it states."""
    block = palpate.load_scene("TI")
    table = table_for(block)
    assert table is not None
    train_touch.SUNK = np.array([depth])
    over, _ = train_touch.random_press(kind_name, block, FIRST + number)
    bare = table.bare_force(over.x, over.sunk, over.theta[0, -2:])[0]
    ratios = table.ratios[kind_name]
    says = ratios(over.x, over.sunk, over.theta)[0] + [1.0, 0.0]
    stated = np.hypot(
        ratios.off_by(over.x, over.theta)[0],
        table.ratios["bare"].off_by(over.x, over.theta[:, -2:])[0] * [1, 0],
    )
    row: dict[str, object] = {}
    for part, true, value, sd in zip(PARTS, over.value[0] / bare, says, stated, strict=True):
        row |= {f"{part}_true": f"{true:.5g}", f"{part}_off": f"{value - true:.3g}"}
        row[f"{part}_stated"] = f"{sd:.3g}"
        row[f"{part}_off_pct"] = f"{100 * abs((value - true) / true) if true else 0.0:.3g}"
    return row


def table(path: Path = KEPT) -> None:
    """How large the errors are beside the force, and how often the stated ones hold."""
    for kind in KINDS:
        rows = [r for r in read(path) if r["kind"] == kind.name]
        for part in PARTS[: 1 + kind.beats]:
            true, off, stated = np.array(
                [[float(r[f"{part}_{what}"]) for what in ("true", "off", "stated")] for r in rows]
            ).T
            share = 100 * np.abs(off) / np.abs(true)
            held = int((np.abs(off) <= 2 * stated).sum())
            print(
                f"{kind.name} {part}: off by {np.median(share):.2g} % (median), "
                f"{np.quantile(share, 0.95):.2g} % (of 95 in 100); within twice the stated error "
                f"{exact(held, len(rows))} %"
            )


def main(presses: int = 60) -> None:
    """Press so many times over each kind, and print the table."""
    jobs = [(kind.name, n, depth) for n in range(presses) for kind in KINDS for depth in DEPTHS]
    fill(KEPT, ("kind", "number", "depth"), ANSWERS, jobs, pressed)
    table()


if __name__ == "__main__":
    run(main)
