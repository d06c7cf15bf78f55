"""Planners on rows of random bodies: presses, contact, and what is found, beside a raster.

    python benchmarks/planners.py [ROWS [DECIDED [EMPTY]]]

Truth is rows of presses of the finite elements, solved at their own places, over nothing, a lump,
an artery, a stenotic one, and two objects 10 to 18 mm apart: other ranges than the tables', blocks
56 to 72 mm wide. A rig adds tilt, bow, waves of 10 to 30 mm in half of the rows, a stage's
repeatability, relaxation, a zero and noise; hearts beat 50 to 100 times a minute. A raster holds
5 s at all stations. Goes on where docs/results/planners.csv ends.
"""

import json
import os
import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, run
from scipy.interpolate import CubicSpline

import palpate
from drivers.core.arrays import Array
from probe.core.recording import Recording, Station
from probe.deciding.coarse_to_fine import CoarseToFine
from probe.deciding.decide import Decide
from probe.planning.plan import Place, Plan
from probe.planning.planner import Press
from sim_backend.fem.newton import CannotSolve
from sim_backend.models.train_touch import SUNK, at_depths
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG, load_wave

KINDS = {"nothing": "nothing", "lump": "tumour", "artery": "artery",
         "stenosis": "stenotic artery", "two": ""}  # fmt: skip
PLANNERS: dict[str, Any] = {"decide": Decide, "coarse-to-fine": CoarseToFine, "raster": None}
SCANS = {f"{planner}, {noise_mn:g} mN": (planner, noise_mn)
         for noise_mn in (0.5, 5.0) for planner in PLANNERS}  # fmt: skip
DEPTH_M, HIGHEST_M = 2.2e-3, 0.3e-3
RAMP_S, HOLD_S, RATE_HZ = 1.0, 5.0, 200.0
CACHE = Path(tempfile.gettempdir()) / "palpate-planners"
OUT = ROOT / "docs" / "results" / "planners.csv"


def body(kind: str, rng: np.random.Generator, width: float, tissue: float) -> dict[str, Any]:
    """An inclusion, which may have no room."""
    place = {"x_mm": rng.uniform(8.0, width - 8.0), "poisson": 0.49}
    if kind == "lump":
        across = rng.uniform(3.0, 11.0)
        return place | {"kind": "tumour", "diameter_mm": across,
                        "depth_mm": across / 2 + rng.uniform(1.5, 8.0),
                        "modulus_kpa": tissue * 10 ** rng.uniform(0.5, 1.7)}  # fmt: skip
    inner, modulus = rng.uniform(2.0, 6.0), 10 ** rng.uniform(2.3, 3.2)
    wall = inner * rng.uniform(0.08, 0.2)
    vessel = place | {"kind": "artery", "inner_diameter_mm": inner, "wall_mm": wall,
                      "depth_mm": inner / 2 + wall + rng.uniform(2.0, 7.0),
                      "modulus_kpa": modulus}  # fmt: skip
    if kind == "stenosis":
        vessel["stenosis"] = {"fraction": rng.uniform(0.25, 0.6),
                              "modulus_kpa": modulus * rng.uniform(2.0, 12.0)}  # fmt: skip
    return vessel


@lru_cache(maxsize=4)
def truth(kind: str, seed: int) -> tuple[Scene, Array, Array]:
    """A scene, its stations [mm], and forces (n, d, 2) [N] at diastole and systole; kept in a
    file."""
    file = CACHE / f"{kind}-{seed}.npz"
    rng = np.random.default_rng([seed, len(kind), 77])
    while not file.exists():
        width, height = rng.uniform(56.0, 72.0), rng.uniform(11.0, 24.0)
        tissue, diastolic = 10 ** rng.uniform(0.9, 2.1), rng.uniform(62.0, 96.0)
        which = {"nothing": [], "two": rng.choice(["lump", "artery"], 2)}.get(kind, [kind])
        bodies = [body(one, rng, width, tissue) for one in which]
        if kind == "two" and not 10 <= abs(bodies[0]["x_mm"] - bodies[1]["x_mm"]) <= 18:
            continue
        x_mm = width / 2 + 4.0 * np.arange(-7, 8) + rng.uniform(-1.5, 1.5)
        x_mm = x_mm[(x_mm > 3.5) & (x_mm < width - 3.5)]
        scene = palpate.load_scene("TI").model_dump(exclude_none=True) | {
            "name": kind, "inclusion": bodies,
            "pulse": {"wave": "brachial", "diastolic_mmhg": diastolic,
                      "systolic_mmhg": diastolic + rng.uniform(25.0, 60.0)},
        }  # fmt: skip
        scene["tissue"] |= {"width_mm": width, "height_mm": height, "modulus_kpa": tissue}
        try:
            made = Scene.model_validate(scene)
            felt = [[at.force_n[[0, -1]] for at in at_depths(made, 1e-3 * x)] for x in x_mm]
        except (CannotSolve, ValueError):
            continue
        file.parent.mkdir(exist_ok=True)
        np.savez(file, scene=made.model_dump_json(exclude_none=True), x_mm=x_mm, felt=felt)
    kept = np.load(file)
    return Scene.model_validate_json(str(kept["scene"])), kept["x_mm"], kept["felt"]


def heights_m(x_m: Array, rng: np.random.Generator) -> Array:
    """How much higher the surface is than the rig takes it to be (n,)."""
    bow = 30e-6 * rng.normal() * (x_m / np.abs(x_m).max()) ** 2
    height = (
        3e-3 * rng.normal() * x_m + bow + 30e-6 * rng.normal() + 8e-6 * rng.normal(size=len(x_m))
    )
    if rng.integers(2):
        turns = 2 * np.pi * x_m / rng.uniform(10e-3, 30e-3) + rng.uniform(0, 6.28)
        height = height + rng.uniform(20e-6, 60e-6) * np.sqrt(2) * np.sin(turns)
    return np.clip(height, -HIGHEST_M, HIGHEST_M)


def recorded(kind: str, noise_mn: float, seed: int) -> Recording:
    """The row as a rig reads it, holds a second too long."""
    scene, x_mm, felt = truth(kind, seed)
    rng = np.random.default_rng([seed, int(10 * noise_mn), len(kind)])
    x_m = 1e-3 * (x_mm - x_mm.mean())
    height_m, face_m2 = heights_m(x_m, rng), 1e-6 * scene.indenter.face_mm2
    t = np.arange(int((RAMP_S + HOLD_S + 1) * RATE_HZ)) / RATE_HZ - RAMP_S
    share = rng.dirichlet([1.0, 1.0, 1.0]) * rng.uniform(0.0, 0.5)
    tau = 10 ** rng.uniform([-0.7, 0.0, 0.7], [-0.2, 0.5, 1.2])
    zero_n, beat_s = 0.7e-3 * rng.normal(), 60 / rng.uniform(50.0, 100.0)
    wave, pulse = load_wave(scene.pulse), scene.pulse
    swing_mmhg = pulse.systolic_mmhg - pulse.diastolic_mmhg
    log_depth = np.log(5e-3 * SUNK)
    down_m = DEPTH_M * np.clip((t + RAMP_S) / RAMP_S, 0, 1)
    stations = []
    for k, x in enumerate(x_mm):
        log_force = CubicSpline(log_depth, np.log(felt[k, :, 0]))
        beat = CubicSpline(log_depth, felt[k, :, 1] / felt[k, :, 0] - 1)
        at = np.log(np.maximum(down_m + height_m[k], 1e-6))
        inside = np.clip(at, log_depth[0], log_depth[-1])
        level = np.exp(log_force(inside) + log_force(log_depth[0], 1) * (at - inside))
        relaxed = level * (1 - share.sum()) + sum(
            s * np.exp(-t / b) * np.cumsum(np.diff(level, prepend=0.0) * np.exp(t / b))
            for s, b in zip(share, tau, strict=True)
        )
        turn_s = (t + rng.uniform(0, beat_s)) / beat_s * wave.period_s
        share_of_swing = (
            wave.pressure_pa(turn_s) / PA_PER_MMHG - pulse.diastolic_mmhg
        ) / swing_mmhg
        force = relaxed + level * beat(inside) * share_of_swing + zero_n
        force = force + 1e-3 * noise_mn * rng.standard_normal(len(t))
        stations.append(Station(
            k, 1e-3 * x, 0.0, t + 10, (force / face_m2)[:, None], np.zeros((len(t), 1), bool),
            10 - RAMP_S, 10.0, 11 + HOLD_S, down_m,
        ))  # fmt: skip
    block = json.loads(
        scene.model_dump_json(exclude_none=True, include={"plane", "tissue", "indenter"})
    )
    return Recording(tuple(stations), ("force",), (), face_m2, block=block)


def held(one: Station, begin_s: float, noise_pa: Any, hold_s: float = HOLD_S) -> Station:
    """A press whose hold begins ``begin_s`` into the one that was made."""
    held_s = one.time_s - one.hold_s
    kept = (ramp := held_s < 0) | ((held_s >= begin_s) & (held_s < begin_s + hold_s))
    return replace(
        one, time_s=np.where(ramp, one.time_s, one.time_s - begin_s)[kept],
        signal_pa=(one.signal_pa + noise_pa)[kept], saturated=one.saturated[kept],
        depth_m=one.depth_m[kept], retract_s=one.hold_s + hold_s,
    )  # fmt: skip


def planned(planner: Any, whole: Recording, drawn: dict[int, Any]) -> tuple[list[Station], Any]:
    """The stations that it presses, and how long each of its choices took [s]."""
    pressed, took_s = dict[int, Station](), list[float]()
    while True:
        began_s = process_time()
        choice = planner.ask()
        took_s.append(process_time() - began_s)
        if not isinstance(choice, Press):
            return [pressed[n] for n in sorted(pressed)], took_s
        n = choice.place.index
        for hold_s in choice.holds_s:
            station = held(whole.stations[n], *drawn[n], hold_s)
            reading = replace(whole, stations=(replace(station, retract_s=np.nan),))
            if hold_s < choice.holds_s[-1] and planner.enough(reading):
                break
        pressed[n] = station
        planner.tell(replace(whole, stations=(station,)))


def judge(scan: str, kind: str, seed: int) -> Row:
    """One scan."""
    planner, noise_mn = SCANS[scan]
    whole = recorded(kind, noise_mn, seed)
    drawn = {s.index: (0.0, 0.0) for s in whole.stations}
    if PLANNERS[planner] is None:
        stations, took_s = [held(s, 0.0, 0.0) for s in whole.stations], [0.0]
    else:
        places = tuple(Place(s.index, s.x_m, 0.0) for s in whole.stations)
        plan = Plan(places, indentation_m=DEPTH_M, ramp_s=RAMP_S, hold_s=HOLD_S)
        stations, took_s = planned(PLANNERS[planner](plan), whole, drawn)
    begun = process_time()
    found = palpate.detect(replace(whole, stations=tuple(stations)))
    row: Row = {"found": found.finding, "presses": len(stations),
                "contact_s": f"{sum(s.retract_s - s.indent_s for s in stations):.1f}",
                "longest_choice_s": f"{max(took_s):.2f}",
                "detect_s": f"{process_time() - begun:.2f}"}  # fmt: skip
    best = max(found.objects, key=lambda thing: thing.confidence, default=None)
    if best is not None and (bodies := truth(kind, seed)[0].inclusion):
        low_mm, high_mm = best.position_ci_mm
        off_mm = min((best.position_mm - one.x_mm for one in bodies), key=abs)
        inside = any(low_mm <= one.x_mm <= high_mm for one in bodies)
        row |= {"off_mm": f"{off_mm:.2f}", "inside": int(inside)}
    return row


def tell() -> None:
    """What is kept, by planner, kind and noise."""
    for (scan, kind), cell in pd.read_csv(OUT).groupby(["scan", "kind"]):
        right = int((cell.found == KINDS[str(kind)]).sum())
        wrong = int((~cell.found.isin([KINDS[str(kind)], "undecided", "cannot see"])).sum())
        inside = exact(int(cell.inside.sum()), int(cell.inside.notna().sum()))
        print(f"{scan}, {kind}: {len(cell)} rows, right {exact(right, len(cell))}, "
              f"otherwise named {exact(wrong, len(cell))} %; presses {cell.presses.mean():.1f}, "
              f"contact {cell.contact_s.mean():.0f} s, off {cell.off_mm.abs().median():.2f} mm, "
              f"inside {inside} %")  # fmt: skip


def main(rows: int = 10, decided: int = 63, empty: int = 500) -> None:
    """Judge so many rows of each kind at each noise; by decide alone so many, and so many with
    nothing in them."""
    jobs = [(scan, kind, seed) for seed in range(max(rows, decided, empty)) for kind in KINDS
            for scan, (planner, _) in SCANS.items()
            if seed < rows or (planner == "decide" and (
                seed < decided or (kind == "nothing" and seed < empty)))]  # fmt: skip
    answers = ("found", "presses", "contact_s", "longest_choice_s", "detect_s", "off_mm", "inside")
    fill(OUT, ("scan", "kind", "seed"), answers, jobs, judge, os.cpu_count() or 1)
    tell()


if __name__ == "__main__":
    run(main)
