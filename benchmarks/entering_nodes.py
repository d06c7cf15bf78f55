"""What nodes that enter the contact one by one give the force, on the meshes of a press.

    python benchmarks/entering_nodes.py [NUMBER ...]

Numbers are those of benchmarks/random_presses.py. Each is pressed at 49 depths from 0.7 of its own
on one mesh; what is left of the force beside a smooth curve is printed peak to peak, in per cent of
the force and of a pressed node's mean share of it: `sim_backend.models.refine.ENTERING_PCT`.
"""

import sys

import numpy as np
from random_presses import random_press

from sim_backend.fem.continuation import continuation
from sim_backend.fem.model import build_section
from sim_backend.fem.newton import Load, unloaded
from sim_backend.models.refine import mesh_grading
from sim_backend.scene.waves import PA_PER_MMHG

NUMBERS = (5, 8, 10, 16, 20, 21, 37, 42, 49, 60, 73, 74)
"""Under round and flat fingers, in both planes, over all kinds; nodes enter in all of them."""
SHARES = (0.5, 0.25)
"""Element size over the finger's half width."""
FROM, DEPTHS, DEGREE = 0.7, 49, 6
"""The first depth over the last, how many, and the degree of the smooth curve."""


def tooth(number: int, share: float) -> tuple[float, int, int]:
    """Peak to peak over the force [%], and how many nodes are pressed at the first and last depth.

    Raises `CannotSolve`.
    """
    scene, x_mm, depth_mm, pressures_mmhg, _ = random_press(number)
    size_m = share * 0.5e-3 * scene.indenter.width_mm_projected
    section = build_section(scene, 1e-3 * x_mm, depth_m=1e-3 * depth_mm, size_m=size_m,
                            grading=mesh_grading(scene, size_m, share))  # fmt: skip
    depths_m = 1e-3 * depth_mm * np.linspace(FROM, 1.0, DEPTHS)
    path = [Load(depth_m, pressures_mmhg[0] * PA_PER_MMHG) for depth_m in depths_m]
    states = list(continuation(section, unloaded(section), path))
    force = np.array([one.force_n_per_m for one in states])
    smooth = np.polynomial.Polynomial.fit(depths_m, force, DEGREE)(depths_m)
    pressed = [int(np.count_nonzero(states[n].multiplier[0] > 0)) for n in (0, -1)]
    return 100 * float(np.ptp(force - smooth)) / float(force[-1]), pressed[0], pressed[1]


def main() -> None:
    """Print a line per press and mesh, and the range."""
    shares_pct = []
    for number in map(int, sys.argv[1:] or NUMBERS):
        for share in SHARES:
            pct, first, last = tooth(number, share)
            shares_pct.append(pct * last)
            print(f"{number}, elements of {share:g}: {first} to {last} nodes, {pct:.4f} % of the "
                  f"force, {shares_pct[-1]:.2f} % of a node's", flush=True)  # fmt: skip
    print(f"{min(shares_pct):.2f} to {max(shares_pct):.2f} %, median {np.median(shares_pct):.2f}")


if __name__ == "__main__":
    main()
