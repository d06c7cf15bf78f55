"""What the fast model costs and how far off it is: training, batches, single states, held-out.

It is trained anew, whatever lies in the cache. Held-out states are random over the whole declared
range and solved by themselves on smaller elements, of two thirds the size. Batches and single
states are timed by the clock, the best of some repeats.
"""

import time
from time import perf_counter
from typing import Any

import numpy as np

import palpate
from sim_backend.models.surrogate import Surrogate, surrogate
from sim_backend.models.trained_states import states, validation
from sim_backend.scene.waves import PA_PER_MMHG

BATCH, SINGLES, REPEATS = 100_000, 2000, 5
HELD_OUT = 60


def speed(model: Surrogate, rng: np.random.Generator) -> tuple[float, float, float]:
    """States per second in batch (best of `REPEATS`), median and p99 of one state [s]."""
    x, d = rng.uniform(*model.range.x_m, BATCH), rng.uniform(*model.range.depth_m, BATCH)
    p = rng.uniform(model.range.pressure_pa[0], min(model.range.pressure_pa[1], 2e4), BATCH)
    z = rng.uniform(*model.range.z_m, BATCH)
    batches, singles = [], []
    for _ in range(REPEATS):
        began = perf_counter()
        model.force_n(x, d, p, z)
        batches.append(perf_counter() - began)
    for i in range(SINGLES):
        began = perf_counter()
        model.force_n(x[i], d[i], p[i], z[i])
        singles.append(perf_counter() - began)
    return BATCH / min(batches), float(np.median(singles)), float(np.quantile(singles, 0.99))


def errors_pct(model: Surrogate, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 2): of force and of pulse, the span from diastole to systole."""
    scene, known = model.scene, model.range
    pulse = (scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg)
    levels = np.array(pulse) * PA_PER_MMHG if scene.arteries else np.zeros(1)
    rows = []
    for _ in range(count):
        x, d, z = (float(rng.uniform(*ends)) for ends in (known.x_m, known.depth_m, known.z_m))
        truth = states(scene, x, z, d, levels, finer=True)[:, 0]
        ours = model.force_n(x, d, levels, z)
        span = max(float(np.ptp(truth)), validation(scene).small_pulse * float(truth.max()))
        rows.append((np.abs(ours / truth - 1).max(), abs(np.ptp(ours) - np.ptp(truth)) / span))
    return 100 * np.array(rows)


def fast_model() -> dict[str, Any]:
    """Training, speed and held-out errors of TIHA's table."""
    scene = palpate.load_scene("TIHA")
    longer = scene.indenter.length_mm + float(np.random.default_rng().uniform(0, 1e-3))
    fresh = scene.indenter.model_copy(update={"length_mm": longer})  # never in the cache
    rng = np.random.default_rng(20)
    spent_s = time.process_time()
    model = surrogate(scene.model_copy(update={"indenter": fresh}), 2.5)
    trained_s = time.process_time() - spent_s
    per_second, median_s, p99_s = speed(model, rng)
    off = errors_pct(model, rng, HELD_OUT)
    return {
        "trained_s": trained_s, "states_per_s": per_second, "one_ms": 1e3 * median_s,
        "one_p99_ms": 1e3 * p99_s, "held_out": HELD_OUT,
        "force_pct": float(off[:, 0].max()), "pulse_pct": float(off[:, 1].max()),
    }  # fmt: skip
