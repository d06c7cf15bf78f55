"""The paper's six scenes, what each is called under three sensors, by seed of the noise.

    python benchmarks/six_scenes.py [SEEDS]

Each scene is scanned once with its default plan and a sensor almost without noise; noise and
resolution of each sensor are then drawn on what was stored. Goes on where
docs/results/six-scenes.csv ends.
"""

import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from kept import ROOT, Row, exact, fill, run

import palpate
from palpate import Recording, Rig

TRUTH = {
    "TI": "nothing", "TIT": "tumour", "TIHA": "artery", "TISA": "stenotic artery",
    "HAOT": "artery", "SAOT": "stenotic artery",
}  # fmt: skip
SENSORS = {"0.5 mN 500 Hz": (0.5e-3, 0.1e-3, 1), "Nano17": (3.1e-3, 3.1e-3, 1),
           "FT300": (0.1, 0.01, 5)}  # fmt: skip
"""Noise and resolution [N], and how many of the stored samples (500 Hz) it takes one of."""
SILENT = ("undecided", "cannot see")
NEXT_TO_NONE_MN = 0.01
"""A sensor without any noise would be taken for one that hangs."""
OUT = ROOT / "docs" / "results" / "six-scenes.csv"
CACHE = Path(tempfile.gettempdir()) / "palpate-six-scenes"


@lru_cache(maxsize=6)
def silent(scene: str) -> Recording:
    """The scene's scan without noise."""
    runs = sorted((CACHE / scene).glob("*.run"))
    if not runs:
        plain: Rig = palpate.default_rig(palpate.load_scene(scene))
        sensor = plain.sensor[0].model_copy(update={"noise_mn": NEXT_TO_NONE_MN, "quantum_mn": 0.0})
        rig = plain.model_copy(update={"sensor": (sensor,)})
        palpate.scan(rig, scene, CACHE / scene)
        runs = sorted((CACHE / scene).glob("*.run"))
    return palpate.open_run(runs[0]).recording()


def noisy(scene: str, sensor: str, seed: int) -> Recording:
    """The scene's scan as a sensor has it."""
    whole = silent(scene)
    noise_n, quantum_n, fold = SENSORS[sensor]
    rng = np.random.default_rng([seed, list(TRUTH).index(scene), list(SENSORS).index(sensor)])
    stations = []
    for one in whole.stations:
        force = one.signal_pa[::fold] * whole.face_m2
        force = force + noise_n * rng.standard_normal(force.shape)
        read_n = np.round(force / quantum_n) * quantum_n
        stations.append(replace(
            one, time_s=one.time_s[::fold], signal_pa=read_n / whole.face_m2,
            saturated=one.saturated[::fold], depth_m=one.depth_m[::fold],
        ))  # fmt: skip
    return replace(whole, stations=tuple(stations))


def judge(scene: str, sensor: str, seed: int) -> Row:
    """One scan's finding."""
    found = palpate.detect(noisy(scene, sensor, seed))
    best = max((one.confidence for one in found.objects), default=float("nan"))
    return {"found": found.finding, "confidence": f"{best:.4f}"}


def main(seeds: int = 50) -> None:
    """Judge, and tell what is kept."""
    jobs = [(scene, sensor, seed) for seed in range(seeds) for sensor in SENSORS for scene in TRUTH]
    rows = fill(OUT, ("scene", "sensor", "seed"), ("found", "confidence"), jobs, judge)
    for sensor in SENSORS:
        for scene, truth in TRUTH.items():
            said = [r["found"] for r in rows if (r["scene"], r["sensor"]) == (scene, sensor)]
            other = {s: said.count(s) for s in dict.fromkeys(said)}
            wrong = sum(s not in (truth, *SILENT) for s in said)
            print(f"{sensor} {scene}: right {exact(said.count(truth), len(said))} %, wrong {wrong} "
                  f"of {len(said)}: {other}")  # fmt: skip


if __name__ == "__main__":
    run(main)
