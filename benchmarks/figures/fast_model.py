"""What the fast model costs and how far off it is: training, batches, single states, held-out.

Held-out states are random over its places, from `SHALLOWEST` of its depth on, and pressed to 0.3 %.
Batches and single states are timed by the clock, the best of some repeats.
"""

import time
from time import perf_counter
from typing import Any

import numpy as np

import palpate
from sim_backend.models.fast import SMALL_PULSE, FastModel
from sim_backend.models.fast import fast_model as solved
from sim_backend.models.place import place
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

BATCH, SINGLES, REPEATS = 100_000, 2000, 5
HELD_OUT = 60
SHALLOWEST = 0.2


def speed(model: FastModel, rng: np.random.Generator) -> tuple[float, float, float]:
    """States per second in batch (best of `REPEATS`), median and p99 of one state [s]."""
    x, d = rng.uniform(*model.range.x_m, BATCH), rng.uniform(*model.range.depth_m, BATCH)
    p = rng.uniform(*model.range.pressure_pa, BATCH)
    batches, singles = [], []
    for _ in range(REPEATS):
        began = perf_counter()
        model.force_n(x, d, p)
        batches.append(perf_counter() - began)
    for i in range(SINGLES):
        began = perf_counter()
        model.force_n(x[i], d[i], p[i])
        singles.append(perf_counter() - began)
    return BATCH / min(batches), float(np.median(singles)), float(np.quantile(singles, 0.99))


def errors_pct(scene: Scene, model: FastModel, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 2): of force and of pulse, the span from diastole to systole."""
    levels = np.array([scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg]) * PA_PER_MMHG
    deepest_m, rows = model.range.depth_m[1], []
    for _ in range(count):
        x, d = float(rng.uniform(*model.range.x_m)), float(rng.uniform(SHALLOWEST, 1) * deepest_m)
        truth = place(scene, x).solve(d, levels.tolist(), accuracy_pct=0.3).force_n
        ours = model.force_n(x, d, levels)
        span = max(float(np.ptp(truth)), SMALL_PULSE * float(truth.max()))
        rows.append((np.abs(ours / truth - 1).max(), abs(np.ptp(ours) - np.ptp(truth)) / span))
    return 100 * np.array(rows)


def fast_model() -> dict[str, Any]:
    """Solving, speed and held-out errors of TIHA's fast model."""
    scene = palpate.load_scene("TIHA")
    rng = np.random.default_rng(20)
    spent_s = time.process_time()
    model = solved(scene, 2.5)
    trained_s = time.process_time() - spent_s
    per_second, median_s, p99_s = speed(model, rng)
    off = errors_pct(scene, model, rng, HELD_OUT)
    return {
        "trained_s": trained_s, "states_per_s": per_second, "one_ms": 1e3 * median_s,
        "one_p99_ms": 1e3 * p99_s, "held_out": HELD_OUT,
        "force_pct": float(off[:, 0].max()), "pulse_pct": float(off[:, 1].max()),
    }  # fmt: skip
