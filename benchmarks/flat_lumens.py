"""Vessels pressed flat: how far a pulse is off, over what is stated of it.

    python benchmarks/flat_lumens.py [CASES]

Arteries of 3 to 7 mm in the lower half of blocks of 12 to 20 mm, under cylinders and flat fingers
that go a quarter to a half of the block deep, 80 to 120 mmHg. Pulses of `press` within 5 % and of a
scan's force model, each against `press` within 0.7 %, of whose own error nothing is kept but what
it states. Goes on where docs/results/flat-lumens.csv ends.
"""

import sys

import numpy as np
import pandas as pd
from kept import ROOT, Row, fill, read

from sim_backend.fem.lumen import flatness
from sim_backend.fem.newton import CannotSolve
from sim_backend.models.refine import Refined, refine
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

OUT = ROOT / "docs" / "results" / "flat-lumens.csv"
PRESSURES_PA = [80 * PA_PER_MMHG, 120 * PA_PER_MMHG]
COARSE_PCT, FINE_PCT = np.array([5.0, 5.0]), np.array([0.3, 0.7])
ANSWERS = ("refused", "flatness", "finest_states_pct", "press_off_pct", "press_states_pct",
           "scan_off_pct", "scan_states_pct")  # fmt: skip


def drawn(case: int) -> tuple[Scene, float, float]:
    """A scene, and where [m] and how deep [m] it is pressed."""
    rng = np.random.default_rng([11, case])
    poisson, height = float(rng.choice([0.45, 0.49])), rng.uniform(12, 20)
    radius = rng.uniform(1.5, 3.5)
    finger: dict[str, object] = {"shape": "cylinder", "radius_mm": rng.uniform(3, 7)}
    if rng.random() > 0.7:
        finger = {"shape": "flat", "width_mm": rng.uniform(5, 10), "edge_radius_mm": 1.0}
    wall = radius * rng.uniform(0.12, 0.35)
    vessel = {
        "kind": "artery", "x_mm": 32.0, "inner_diameter_mm": 2 * (radius - wall), "wall_mm": wall,
        "depth_mm": radius + (height - 2 * radius) * rng.uniform(0.4, 0.9), "poisson": poisson,
        "modulus_kpa": 150 * (1000 / 150) ** rng.random(),
    }  # fmt: skip
    scene = Scene.model_validate({
        "name": f"flat {case}", "plane": str(rng.choice(["stress", "strain"])),
        "tissue": {"width_mm": 64.0, "height_mm": height, "modulus_kpa": 20 * 4 ** rng.random(),
                   "poisson": poisson},
        "inclusion": [vessel], "indenter": finger | {"length_mm": 10.0},
    })  # fmt: skip
    x_mm = 32.0 + float(rng.choice([0.0, rng.uniform(-2, 2)]))
    return scene, 1e-3 * x_mm, 1e-3 * height * rng.uniform(0.25, 0.5)


def judge(case: str) -> Row:
    """One case's errors and what is stated of them [% of the pulse]."""
    scene, x_m, depth_m = drawn(int(case))
    try:
        pressed, finest = (
            refine("finite", scene, x_m, depth_m, PRESSURES_PA, budget_pct)
            for budget_pct in (COARSE_PCT, FINE_PCT)
        )
        model = respond(scene, x_m, depth_m)
    except CannotSolve as limit:
        return {"refused": limit.limit}
    truth = _pulse_n(finest, scene)
    section, states = finest.solved
    flat = max(flatness(section.lumens, one.displacement) for one in states)
    low, high = (float(model.force_n(x_m, depth_m, p)) for p in PRESSURES_PA)
    states_n = float(model.pulse_error_n(x_m, depth_m, *PRESSURES_PA))
    found = {
        "flatness": flat, "finest_states_pct": finest.error_pct[1],
        "press_off_pct": 100 * (_pulse_n(pressed, scene) / truth - 1),
        "press_states_pct": pressed.error_pct[1],
        "scan_off_pct": 100 * ((high - low) / truth - 1),
        "scan_states_pct": 100 * states_n / (high - low),
    }  # fmt: skip
    return {name: f"{value:.3g}" for name, value in found.items()}


def _pulse_n(one: Refined, scene: Scene) -> float:
    forces = [state.force_n_per_m for state in one.solved[1]]
    return 1e-3 * scene.indenter.length_mm * float(np.ptp(forces))


def main(cases: int) -> None:
    """Solve what is missing, and tell errors over what is stated."""
    fill(OUT, ("case",), ANSWERS, [(str(case),) for case in range(cases)], judge)
    table = pd.DataFrame(read(OUT))
    print(table[table.refused != ""].refused.value_counts().to_string())
    table = table[table.refused == ""].apply(pd.to_numeric, errors="coerce")
    sure = table[table.finest_states_pct <= 2.5]
    for way in ("press", "scan"):
        off = sure[f"{way}_off_pct"].abs()
        over = off / sure[f"{way}_states_pct"]
        print(f"{way}: {len(over)} of {len(table)} judged, off by at most {off.max():.1f} %; over "
              f"what is stated {over.median():.2f} (median), {over.max():.2f} at most, "
              f"{(over > 1).sum()} above 1, {(over > 2).sum()} above 2")  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
