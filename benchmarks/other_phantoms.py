"""Detection on phantoms that share nothing with the population that it judges by.

    python benchmarks/other_phantoms.py PULSES.csv.gz [SCANS]

Rows over whole blocks, ends included: every station of a block of random width is solved where it
is (`sim_backend.models.station_response`), in plane strain, most under a flat finger, the object
anywhere in the row; 11 to 17 stations 3 to 5 mm apart; ranges of moduli, sizes and pressures of
their own. Waves are stretches of radial recordings. Surfaces are wavy in half of the scans (0.05 mm
rms over 15 mm: the depth that the stage does not know of). Goes on where
docs/results/other-phantoms.csv ends.
"""

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, read, run
from real_data import pulses

from drivers.core.arrays import Array
from probe.core.recording import Recording, Station
from probe.detection import detect
from sim_backend.fem.newton import CannotSolve
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.waves import PA_PER_MMHG

KINDS = ("nothing", "tumour", "artery", "stenotic artery")
NEAR_END_MM = 12.0
HOLD_S, RATE_HZ = 4.0, 200.0
WAVY_MM, WAVE_MM = 0.05, 15.0
HIGHER_WITH_DEPTH = 1.2
"""Exponent of force over depth under these fingers."""
CACHE = Path(tempfile.gettempdir()) / "palpate-other-phantoms"
OUT = ROOT / "docs" / "results" / "other-phantoms.csv"


def drawn(kind: str, rng: np.random.Generator) -> tuple[Scene, Array, float]:
    """A scene, its stations [mm] and depth [m]."""
    pitch, count = rng.uniform(3.0, 5.0), int(rng.integers(11, 18))
    width, height = pitch * (count + 1), rng.uniform(12.0, 22.0)
    tissue = rng.uniform(8.0, 80.0)
    outer = rng.uniform(3.0, 7.0)
    low, high = outer / 2 + 1.2, min(height - outer / 2 - 1.0, 11.0)
    place = {"x_mm": rng.uniform(outer / 2 + pitch, width - outer / 2 - pitch),
             "depth_mm": rng.uniform(low, high), "poisson": 0.49}  # fmt: skip
    inside: list[dict[str, Any]] = []
    if kind == "tumour":
        inside = [place | {"kind": "tumour", "diameter_mm": outer,
                           "modulus_kpa": tissue * rng.uniform(5.0, 30.0)}]  # fmt: skip
    elif kind != "nothing":
        wall = outer * rng.uniform(0.08, 0.13)
        vessel = place | {"kind": "artery", "inner_diameter_mm": outer - 2 * wall, "wall_mm": wall,
                          "modulus_kpa": rng.uniform(250.0, 900.0)}  # fmt: skip
        if kind == "stenotic artery":
            vessel["stenosis"] = {"fraction": rng.uniform(0.25, 0.55),
                                  "modulus_kpa": rng.uniform(1500.0, 9000.0)}  # fmt: skip
        inside = [vessel]
    flat = {"shape": "flat", "width_mm": rng.uniform(5.0, 9.0), "edge_radius_mm": 1.5}
    round_ = {"shape": "cylinder", "radius_mm": rng.uniform(3.5, 7.0)}
    diastolic = rng.uniform(65.0, 95.0)
    scene = Scene.model_validate({
        "name": kind, "plane": "strain",
        "tissue": {"width_mm": width, "height_mm": height, "modulus_kpa": tissue, "poisson": 0.48},
        "inclusion": inside, "indenter": flat if rng.uniform() < 0.6 else round_,
        "pulse": {"wave": "brachial", "diastolic_mmhg": diastolic,
                  "systolic_mmhg": diastolic + rng.uniform(30.0, 60.0)},
    })  # fmt: skip
    return scene, pitch * np.arange(1, count + 1), 1e-3 * height * rng.uniform(0.08, 0.15)


@lru_cache(maxsize=1)
def waves(file: Path) -> list[tuple[Array, Array]]:
    return pulses(file)


def solved(scene: Scene, x_mm: Array, depth_m: float, file: Path) -> Array:
    """Forces at diastole and pulses (2, n) [N], NaN where they cannot be solved; kept in a file."""
    if not file.exists():
        file.parent.mkdir(exist_ok=True)
        try:
            beat = scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg
            beat_pa = [PA_PER_MMHG * p for p in beat]
            felt = np.array([
                respond(scene, x, depth_m).force_n(depth_m, beat_pa) for x in 1e-3 * x_mm
            ])  # fmt: skip
            np.save(file, np.array([felt[:, 0], felt[:, 1] - felt[:, 0]]))
        except CannotSolve:
            np.save(file, np.full((2, len(x_mm)), np.nan))
    return np.asarray(np.load(file))


def recorded(scene: Scene, x_mm: Array, depth_m: float, felt: Array,
             hearts: list[tuple[Array, Array]], rng: np.random.Generator) -> Recording:  # fmt: skip
    """The scan as a sensor of 0.3 to 3 mN would have it."""
    face_m2 = 1e-6 * scene.indenter.face_mm2
    noise_n = 10 ** rng.uniform(-3.5, -2.5)
    grams = rng.dirichlet([1.0, 1.0, 1.0]) * rng.uniform(0.0, 0.6)
    taus = 10 ** rng.uniform([-0.7, 0.0, 0.7], [-0.2, 0.5, 1.2])
    turns = 2 * np.pi * np.cumsum(np.diff(x_mm, prepend=0.0)) / WAVE_MM + rng.uniform(0, 6.28)
    wavy_mm = rng.integers(2) * WAVY_MM * np.sqrt(2) * np.sin(turns)
    deeper = 1 + HIGHER_WITH_DEPTH * wavy_mm / (1e3 * depth_m)
    t = np.arange(int(HOLD_S * RATE_HZ)) / RATE_HZ
    decay = 1 - (grams * (1 - np.exp(-t[:, None] / taus))).sum(axis=1)
    beat_s, wave = hearts[rng.integers(len(hearts))]
    stations = []
    for k, x in enumerate(x_mm):
        begun = rng.uniform(0.0, beat_s[-1] - HOLD_S)
        beat = np.interp(t + begun, beat_s, wave) + 0.4
        scatter = 1 + 0.003 * rng.standard_normal()
        force = felt[0, k] * deeper[k] * scatter * decay + felt[1, k] * beat
        force = force + noise_n * rng.standard_normal(len(t))
        stations.append(Station(
            k, 1e-3 * x, 0.0, t + 10, (force / face_m2)[:, None], np.zeros((len(t), 1), dtype=bool),
            9.0, 10.0, 10 + t[-1], np.full(len(t), depth_m),
        ))  # fmt: skip
    return Recording(tuple(stations), ("force",), (), face_m2)


ANSWERS = ("x_mm", "width_mm", "found", "kind_confidence", "position_mm", "low_mm", "high_mm",
           "contrast", "pulse_share")  # fmt: skip


def main(file: Path, scans: int = 150) -> None:
    """Judge, and tell what is kept."""

    def judge(kind: str, seed: int) -> Row | None:
        rng = np.random.default_rng([77, seed, KINDS.index(kind)])
        try:
            scene, x_mm, depth_m = drawn(kind, rng)
        except SceneError:
            return None
        felt = solved(scene, x_mm, depth_m, CACHE / f"{kind}-{seed}.npy")
        if not np.isfinite(felt).all():
            return None
        found = detect(recorded(scene, x_mm, depth_m, felt, waves(file), rng))
        best = max(found.objects, key=lambda one: one.confidence, default=None)
        row: dict[str, object] = {"found": found.finding, "width_mm": scene.tissue.width_mm
                                  if scene.tissue else np.nan}  # fmt: skip
        if scene.inclusion:
            x = scene.inclusion[0].x_mm
            at = int(np.argmin(np.abs(x_mm - x)))
            row |= {"x_mm": f"{x:.3f}", "pulse_share": felt[1, at] / felt[0, at],
                    "contrast": felt[0, at] / np.median(felt[0]) - 1}  # fmt: skip
        if best is not None:
            low, high = best.position_ci_m
            row |= {"kind_confidence": best.confidence, "position_mm": 1e3 * best.position_m,
                    "low_mm": 1e3 * low, "high_mm": 1e3 * high}  # fmt: skip
        return row

    jobs = [(kind, seed) for seed in range(scans) for kind in KINDS]
    fill(OUT, ("kind", "seed"), ANSWERS, jobs, judge)
    tell()


def tell() -> None:
    """Places, names and confident errors of what is kept."""
    table = pd.DataFrame(read(OUT))
    table = table[table.found != ""]
    number = ("x_mm", "width_mm", "position_mm", "low_mm", "high_mm", "kind_confidence")
    table[list(number)] = table[list(number)].apply(pd.to_numeric, errors="coerce")
    print(pd.crosstab(table.kind, table.found))
    placed = table[(table.kind != "nothing") & table.low_mm.notna()]
    inside = (placed.low_mm <= placed.x_mm) & (placed.x_mm <= placed.high_mm)
    end_mm = np.minimum(placed.x_mm, placed.width_mm - placed.x_mm)
    for name, which in (("all", end_mm > 0), ("near an end", end_mm <= NEAR_END_MM),
                        ("elsewhere", end_mm > NEAR_END_MM)):  # fmt: skip
        off = (placed.position_mm - placed.x_mm)[which]
        print(f"places {name}: {exact(int(inside[which].sum()), int(which.sum()))} % of "
              f"{which.sum()}, median error {off.abs().median():.2f} mm")  # fmt: skip
    sure = table[(table.kind_confidence >= 0.95) & table.found.isin(KINDS[1:])]
    wrong = int((sure.found != sure.kind).sum())
    print(f"named at 95 % or more: right {exact(len(sure) - wrong, len(sure))} % of {len(sure)}; "
          f"confident errors {exact(wrong, len(table))} % of {len(table)}")  # fmt: skip


if __name__ == "__main__":
    run(main)
