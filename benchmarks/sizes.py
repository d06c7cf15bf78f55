"""Depth, diameter, modulus and stenosis of random bodies from rows of presses: do 95 % intervals
hold?

    python benchmarks/sizes.py [ROWS]

Truth is a row of 15 presses of the finite elements over one lump or vessel, which no table was
trained on, with what a rig adds: tilt, bow and height of the surface, a stage's repeatability, a
gain of each depth, a zero, and noise. Of a stenotic artery there is a second row, over the same
vessel where it is open.
"""

from collections import Counter
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from kept import ROOT, Row, exact, fill, read, run
from scipy.interpolate import CubicSpline

import palpate
from probe.detection.beneath.grid_sizes import narrowed_sizes
from probe.detection.beneath.hypotheses import Likelihood
from probe.detection.beneath.narrowing import TwoRows
from probe.detection.beneath.row_data import RowData
from probe.detection.beneath.row_evidence import evidence_of
from probe.detection.finding import NARROWED
from probe.detection.sizes import NAMES, UNITS
from sim_backend.fem.newton import CannotSolve
from sim_backend.models.train_touch import SUNK, at_depths
from sim_backend.scene.scene_file import Scene
from sim_backend.touch.bodies import Units
from sim_backend.touch.kept import table_for
from sim_backend.touch.kinds import LUMP, VESSEL

KEPT = ROOT / "docs/results/sizes.csv"
COUNT = 15
NEAR_M = 5e-3
BODIES = {"tumour": LUMP, "artery": VESSEL, "stenotic artery": VESSEL}
KINDS = {"tumour": 1, "artery": 1, "stenotic artery": 2}
"""Rows that each is judged by."""
ANSWERS = (*(f"{name}_{part}" for name in NAMES for part in ("true", "low", "high")), "found")


def body(kind: str, seed: int) -> np.ndarray:
    """Parameters of a body within what a table knows."""
    rng, shape = np.random.default_rng([seed, len(kind)]), BODIES[kind]
    low, high = np.array(shape.low), np.array(shape.high)
    while True:
        theta = low + (high - low) * rng.random(len(low))
        if shape.beats:  # pressures of people over the tissue's modulus of `UNITS`
            pressure, swing = rng.uniform(60, 100), rng.uniform(20, 62)
            theta[shape.parameters.index("log_pressure")] = np.log(pressure * 133.322 / 50e3)
            theta[shape.parameters.index("swing")] = swing / pressure
            if kind == NARROWED:
                theta[shape.parameters.index("narrowing")] = rng.uniform(0.1, 0.65)
            elif seed % 2:
                theta[shape.parameters.index("narrowing")] = 0.0
        if shape.fits(theta[None])[0]:
            return theta


@lru_cache(maxsize=4)
def truth(kind: str, seed: int) -> tuple[np.ndarray, Scene, np.ndarray, list[np.ndarray]]:
    """Parameters (p,), the scene, places (15,) [m], and of each row forces (15, d, 2) [N] at
    diastole and systole."""
    units, shape = Units(palpate.load_scene("TI")), BODIES[kind]
    while True:
        theta = body(kind, seed)
        scenes = [units.scene((shape, theta))]
        if KINDS[kind] > 1:
            healthy = theta.copy()
            healthy[shape.parameters.index("narrowing")] = 0.0
            if not shape.fits(healthy[None])[0]:
                seed += 1000
                continue
            scenes.append(units.scene((shape, healthy)))
        half_m = 1e-3 * units.length_mm * float(np.exp(theta[-1]))
        x_m = np.linspace(max(theta[0] * 5e-3 - 28e-3, 4e-3 - half_m),
                          min(theta[0] * 5e-3 + 28e-3, half_m - 4e-3), COUNT) + half_m  # fmt: skip
        try:
            rows = [
                [[at.force_n_per_m for at in at_depths(scene, x)] for x in x_m] for scene in scenes
            ]
        except (CannotSolve, ValueError):
            seed += 1000
            continue
        length_m = 1e-3 * scenes[0].indenter.length_mm
        return theta, scenes[0], x_m, [length_m * np.array(row) for row in rows]


def measured(
    at_m: np.ndarray, force: np.ndarray, pulse: np.ndarray, noise_n: float, seed: int
) -> RowData:
    """What a rig would have read."""
    rng, sunk_m = np.random.default_rng([seed, 7]), 5e-3 * SUNK
    x_m = at_m - at_m.mean()
    height_m = 5e-3 * rng.normal() * x_m + 30e-6 * rng.normal() * (x_m / x_m.max()) ** 2
    height_m = height_m + 30e-6 * rng.normal() + 8e-6 * rng.normal(size=COUNT)
    row = RowData(at_m, sunk_m, force, np.full_like(force, noise_n), pulse[:, -1], pulse[:, -1])
    # a force is nearly a power of depth
    deep = np.log(np.maximum(sunk_m + height_m[:, None], 1e-6))
    force = np.exp([
        CubicSpline(np.log(sunk_m), np.log(each), bc_type="natural")(at)
        for each, at in zip(force, deep, strict=True)
    ])  # fmt: skip
    force = force * (1 + 0.1 * rng.normal(size=len(SUNK))) + 1e-3 * rng.normal()
    force = force + noise_n * rng.normal(size=force.shape)
    beat_n = 0.4 * noise_n  # a pulse of many beats is known better than one level
    seen = pulse[:, -1] * (1 + 0.04 * rng.normal(size=COUNT)) + beat_n * rng.normal(size=COUNT)
    seen = np.where(np.abs(seen) < 3 * beat_n, 0.0, np.abs(seen))
    spread = np.where(seen == 0, 1.5 * beat_n, beat_n)
    return replace(row, force_n=force, pulse_n=seen, pulse_sd_n=spread)


def judged(kind: str, noise_mn: float, seed: int) -> Row | None:
    """One body: what was stated, and whether it holds."""
    theta, scene, x_m, rows = truth(kind, seed)
    each = [
        measured(x_m, row[..., 0], row[..., -1] - row[..., 0], 1e-3 * noise_mn, seed + 10_000 * n)
        for n, row in enumerate(rows)
    ]
    if any((data.force_n <= 0).any() for data in each):
        return None
    table = table_for(scene)
    assert table is not None
    first, *others = [Likelihood(data, table, scene) for data in each]
    if others:
        said = narrowed_sizes(TwoRows(first, *others))
    else:
        evidence = evidence_of(first, 1.0, 1e-6 * scene.indenter.face_mm2)
        if isinstance(evidence, str):
            return {"found": "unknown"}
        at_m = first.middle_m + 5e-3 * theta[0]
        there = [
            thing for thing, body in zip(evidence.objects, evidence.bodies.kinds, strict=False)
            if body == BODIES[kind] and abs(thing.position_m - at_m) < NEAR_M
        ]  # fmt: skip
        if not there:
            named = any(thing.is_named for thing in evidence.objects)
            return {"found": "otherwise" if named else "undecided" if evidence.objects else "none"}
        said = there[0].sizes
    shape = dict(zip(BODIES[kind].parameters, theta, strict=True))
    true = {
        "depth": 5e-3 * shape["depth"],
        "diameter": 5e-3 * np.exp(shape.get("log_diameter", shape.get("log_inner", 0.0))),
        "modulus": 50e3 * np.exp(shape["log_ratio"]), "stenosis": shape.get("narrowing", np.nan),
    }  # fmt: skip
    row: dict[str, object] = {}
    for name, unit in UNITS.items():
        low, high = getattr(said, f"{name}_ci{unit}")
        row |= {f"{name}_true": f"{true[name]:.5g}", f"{name}_low": f"{low:.5g}"}
        row[f"{name}_high"] = f"{high:.5g}"
    return row | {"found": "stated" if len(said.undecided) < 3 else "unknown"}


def table(path: Path = KEPT) -> None:
    """How often the intervals held."""
    for kind in KINDS:
        for noise in ("0.5", "5.0"):
            rows = [r for r in read(path) if (r["kind"], r["noise_mn"]) == (kind, noise)]
            rows = [r for r in rows if r["found"]]
            print(f"{kind} {noise} mN: {dict(Counter(r['found'] for r in rows))}")
            for name in NAMES:
                ends = [
                    [float(r[f"{name}_{p}"] or "nan") for p in ("low", "true", "high")]
                    for r in rows
                ]
                given = [e for e in ends if not np.isnan(e[0]) or not np.isnan(e[2])]
                held = sum(low <= true <= high for low, true, high in given)
                share = f"{exact(held, len(given))} % of {len(given)}, of {len(rows)} rows"
                print(f"{kind} {noise} mN {name}: held {share}")


def main(rows: int = 60) -> None:
    """Judge so many rows of each kind at each noise, and print the table."""
    jobs = [(kind, noise, seed) for seed in range(rows) for kind in KINDS for noise in (0.5, 5.0)]
    fill(KEPT, ("kind", "noise_mn", "seed"), ANSWERS, jobs, judged)
    table()


if __name__ == "__main__":
    run(main)
