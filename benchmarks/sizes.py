"""Depth, diameter and modulus of random bodies from rows of presses: do 95 % intervals hold?

    python benchmarks/sizes.py [ROWS]

Truth is a row of 15 presses of the finite elements over one lump or vessel, which no table was
trained on, with what a rig adds: tilt, bow and height of the surface, a stage's repeatability, a
gain of each depth, a zero, and noise.
"""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from kept import ROOT, Row, exact, fill, read, run

import palpate
from probe.detection.beneath.explain import explained, sizes
from probe.detection.beneath.hypotheses import HYPOTHESES, Likelihood
from probe.detection.beneath.rivals import likeliest
from probe.detection.beneath.row_data import RowData
from sim_backend.fem.newton import CannotSolve
from sim_backend.models.train_touch import SUNK, Units, ramp
from sim_backend.scene.scene_file import Scene
from sim_backend.touch.kept import table_for

KEPT = ROOT / "docs/results/sizes.csv"
COUNT = 15
NAMES = ("depth", "diameter", "modulus")
ANSWERS = (*(f"{name}_{part}" for name in NAMES for part in ("true", "low", "high")), "found")


def body(kind: str, seed: int) -> np.ndarray:
    """Parameters of a body within what a table knows."""
    rng, shape = np.random.default_rng([seed, len(kind)]), HYPOTHESES[kind]
    low, high = np.array(shape.low), np.array(shape.high)
    while True:
        theta = low + (high - low) * rng.random(len(low))
        if shape.beats:  # pressures of people over the tissue's modulus of `UNITS`
            pressure, swing = rng.uniform(60, 100), rng.uniform(20, 62)
            theta[shape.parameters.index("log_pressure")] = np.log(pressure * 133.322 / 50e3)
            theta[shape.parameters.index("swing")] = swing / pressure
            if seed % 2:
                theta[shape.parameters.index("narrowing")] = 0.0
        if shape.fits(theta[None])[0]:
            return theta


@lru_cache(maxsize=4)
def truth(kind: str, seed: int) -> tuple[np.ndarray, Scene, np.ndarray, np.ndarray, np.ndarray]:
    """Parameters (p,), the scene, places (15,) [m], forces (15, d) and pulses (15, d) [N]."""
    units = Units(palpate.load_scene("TI"))
    while True:
        theta = body(kind, seed)
        scene = units.scene(HYPOTHESES[kind], theta)
        half_m = 1e-3 * units.length_mm * float(np.exp(theta[-1]))
        x_m = np.linspace(max(theta[0] * 5e-3 - 28e-3, 4e-3 - half_m),
                          min(theta[0] * 5e-3 + 28e-3, half_m - 4e-3), COUNT) + half_m  # fmt: skip
        try:
            rows = [[solved.force_n_per_m for solved in ramp(scene, x)] for x in x_m]
        except (CannotSolve, ValueError):
            seed += 1000
            continue
        force = 1e-3 * scene.indenter.length_mm * np.array(rows)
        return theta, scene, x_m, force[..., 0], force[..., -1] - force[..., 0]


def measured(
    at_m: np.ndarray, force: np.ndarray, pulse: np.ndarray, noise_n: float, seed: int
) -> RowData:
    """What a rig would have read."""
    rng, sunk_m = np.random.default_rng([seed, 7]), 5e-3 * SUNK
    x_m = at_m - at_m.mean()
    height_m = 5e-3 * rng.normal() * x_m + 30e-6 * rng.normal() * (x_m / x_m.max()) ** 2
    height_m = height_m + 30e-6 * rng.normal() + 8e-6 * rng.normal(size=COUNT)
    row = RowData(at_m, sunk_m, force, np.full_like(force, noise_n), pulse[:, -1], pulse[:, -1])
    force = force + row.slope_n_per_m * height_m[:, None]
    force = force * (1 + 0.1 * rng.normal(size=len(SUNK))) + 1e-3 * rng.normal()
    force = force + noise_n * rng.normal(size=force.shape)
    beat_n = 0.4 * noise_n  # a pulse of many beats is known better than one level
    seen = pulse[:, -1] * (1 + 0.04 * rng.normal(size=COUNT)) + beat_n * rng.normal(size=COUNT)
    seen = np.where(np.abs(seen) < 3 * beat_n, 0.0, np.abs(seen))
    spread = np.where(seen == 0, 1.5 * beat_n, beat_n)
    return replace(row, force_n=force, pulse_n=seen, pulse_sd_n=spread)


def judged(kind: str, noise_mn: float, seed: int) -> Row | None:
    """One row: what was stated, and whether it holds."""
    theta, scene, x_m, force, pulse = truth(kind, seed)
    data = measured(x_m, force, pulse, 1e-3 * noise_mn, seed)
    if (data.force_n <= 0).any():
        return None
    table = table_for(scene)
    assert table is not None
    likelihood = Likelihood(data, table, scene)
    found = likeliest([(HYPOTHESES[kind],)], likelihood)
    said = sizes(found.bodies, 0, explained(found, likelihood), likelihood)
    shape = dict(zip(HYPOTHESES[kind].parameters, theta, strict=True))
    across = shape.get("log_diameter", shape.get("log_inner", 0.0))
    true = {
        "depth": 5e-3 * shape["depth"], "diameter": 5e-3 * np.exp(across),
        "modulus": 50e3 * np.exp(shape["log_ratio"]),
    }  # fmt: skip
    ends = {"depth": said.depth_ci_m, "diameter": said.diameter_ci_m,
            "modulus": said.modulus_ci_pa}  # fmt: skip
    row: dict[str, object] = {}
    for name in NAMES:
        low, high = ends[name]
        row |= {f"{name}_true": f"{true[name]:.5g}", f"{name}_low": f"{low:.5g}"}
        row[f"{name}_high"] = f"{high:.5g}"
    return row | {"found": "stated" if len(said.undecided) < 3 else "unknown"}


def table(path: Path = KEPT) -> None:
    """How often the intervals held."""
    for kind in ("tumour", "artery"):
        for noise in ("0.5", "5.0"):
            rows = [r for r in read(path) if (r["kind"], r["noise_mn"]) == (kind, noise)]
            rows = [r for r in rows if r["found"]]
            for name in NAMES:
                ends = [[float(r[f"{name}_{p}"]) for p in ("low", "true", "high")] for r in rows]
                given = [e for e in ends if not np.isnan(e[0]) or not np.isnan(e[2])]
                held = sum(low <= true <= high for low, true, high in given)
                share = f"{exact(held, len(given))} % of {len(given)}, of {len(rows)} rows"
                print(f"{kind} {noise} mN {name}: held {share}")


def main(rows: int = 60) -> None:
    """Judge so many rows of each kind at each noise, and print the table."""
    jobs = [
        (kind, noise, seed)
        for seed in range(rows)
        for kind in ("tumour", "artery")
        for noise in (0.5, 5.0)
    ]
    fill(KEPT, ("kind", "noise_mn", "seed"), ANSWERS, jobs, judged)
    table()


if __name__ == "__main__":
    run(main)
