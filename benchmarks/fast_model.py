"""What the fast model costs and how far off it is: training, batches, single states, held-out.

    python benchmarks/fast_model.py [SCENE] [HELD_OUT]

It is trained anew, whatever lies in the cache. Held-out states are random over the whole declared
range and solved by themselves on smaller elements: of two thirds the size in a section, of the next
mesh that `palpate press` would take in a solid. Training is given by the clock and in seconds of
both processors; batches and single states by the clock, the best of some repeats.
"""

import sys
from os import times
from time import perf_counter

import numpy as np

from sim_backend.models.surrogate import Surrogate, surrogate
from sim_backend.models.trained_states import states, validation
from sim_backend.scene.scene_file import load_scene
from sim_backend.scene.waves import PA_PER_MMHG

BATCH, SINGLES, REPEATS = 100_000, 2000, 5


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


def processors_s() -> float:
    """Seconds of processors so far, of this process and of those that it started."""
    return sum(times()[:4])


def main() -> None:
    """Train, time, compare, print."""
    scene = load_scene(sys.argv[1] if len(sys.argv) > 1 else "TIHA")
    held_out = int(sys.argv[2]) if len(sys.argv) > 2 else 30
    rng = np.random.default_rng(20)
    assert scene.tissue is not None
    # a name of its own does not change the cache's key; a tissue a hair stiffer does
    modulus_kpa = scene.tissue.modulus_kpa * (1 + 1e-4 * float(np.random.default_rng().uniform()))
    fresh = scene.tissue.model_copy(update={"modulus_kpa": modulus_kpa})
    began, spent_s = perf_counter(), processors_s()
    model = surrogate(scene.model_copy(update={"tissue": fresh}), 2.5)
    trained_s, processor_s = perf_counter() - began, processors_s() - spent_s
    rate, median_s, p99_s = speed(model, rng)
    off = errors_pct(model, rng, held_out)
    print(f"{scene.name}: trained in {trained_s:.1f} s by the clock, "
          f"{processor_s:.1f} s of processors")  # fmt: skip
    print(f"batch of {BATCH}: {rate:,.0f} states/s")
    print(f"one state: median {1e3 * median_s:.3f} ms, p99 {1e3 * p99_s:.3f} ms")
    print(f"{held_out} held-out states, force: median {np.median(off[:, 0]):.2f} %, largest "
          f"{off[:, 0].max():.2f} % (stated {model.force_error_pct:.2f} %)")  # fmt: skip
    print(f"{held_out} held-out states, pulse: median {np.median(off[:, 1]):.2f} %, largest "
          f"{off[:, 1].max():.2f} % (stated {model.pulse_error_pct:.2f} %)")  # fmt: skip


if __name__ == "__main__":
    main()
