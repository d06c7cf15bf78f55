"""Grids over random vessels, balls and nothing: what is called, where, and in which rows.

    python benchmarks/random_grids.py [GRIDS]

Each is scanned as `palpate scan` would: 9 to 14 columns and 3 to 6 rows at random, vessels that
run obliquely, stenoses of two or three rows, holds of 0.9 to 4 s, a sensor of 50 to 500 Hz. A wrong
name is any that is not the truth; *undecided* and *cannot see* are none, nor is *nothing* where
something is. A place is right if the interval holds the truth in its row, a stretch if it has the
very rows of the stenosis. Goes on where docs/results/random-grids.csv ends.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from kept import ROOT, Row, exact, fill, run

import palpate
from drivers.core.arrays import Array
from palpate import Rig

KINDS, SHARES = ("nothing", "tumour", "artery", "stenotic artery"), (0.15, 0.25, 0.3, 0.3)
OUT = ROOT / "docs" / "results" / "random-grids.csv"
ANSWERS = ("truth", "found", "confidence", "place", "stretch", "rows", "hold_s", "rate_hz")
WIDTH_MM = 80.0


def drawn(seed: int) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """The truth, a scene and a rig."""
    rng = np.random.default_rng(seed)
    truth = str(rng.choice(KINDS, p=SHARES))
    columns, rows = int(rng.integers(9, 15)), int(rng.integers(3, 7))
    pitch, apart = float(rng.choice([3.0, 4.0, 5.0])), float(rng.choice([2.0, 3.0, 4.0, 5.0]))
    x_mm = (WIDTH_MM - (columns - 1) * pitch) / 2 + rng.uniform(-2, 2) + pitch * np.arange(columns)
    y_mm = rng.uniform(-8, 0) + apart * np.arange(rows)
    place = {"x_mm": rng.uniform(x_mm[2], x_mm[-3]), "depth_mm": rng.uniform(5.5, 9.5),
             "poisson": 0.49}  # fmt: skip
    inside: list[dict[str, Any]] = []
    if truth == "tumour":
        across = rng.uniform(4, 8)
        off = rng.uniform(-0.3, 0.3) * apart
        inside = [place | {"kind": "tumour", "diameter_mm": across,
                           "modulus_kpa": rng.uniform(300, 1500),
                           "depth_mm": rng.uniform(across / 2 + 1.5, 9),
                           "z_mm": rng.choice(y_mm[1:-1]) + off}]  # fmt: skip
    elif truth != "nothing":
        ends, oblique = (y_mm[0] - 1, y_mm[-1] + 1), rng.uniform(-0.35, 0.35)
        path = [[z, place["x_mm"] + oblique * (z - np.mean(ends)), place["depth_mm"]] for z in ends]
        vessel = place | {"kind": "artery", "path": path, "inner_diameter_mm": rng.uniform(3, 5),
                          "wall_mm": rng.uniform(0.4, 0.8),
                          "modulus_kpa": rng.uniform(300, 700)}  # fmt: skip
        if truth == "stenotic artery":
            first = int(rng.integers(0, rows - 1))
            last = min(rows - 1, first + int(rng.integers(1, 3)))
            vessel["stenosis"] = {
                "fraction": rng.uniform(0.3, 0.6), "modulus_kpa": rng.uniform(1500, 4000),
                "z_mm": [y_mm[first] - 0.4 * apart, y_mm[last] + 0.4 * apart],
            }  # fmt: skip
        inside = [vessel]
    scene = {
        "name": f"grid-{seed}", "plane": str(rng.choice(["stress", "strain"])),
        "tissue": {"width_mm": WIDTH_MM, "height_mm": rng.uniform(14, 20),
                   "modulus_kpa": rng.uniform(25, 80), "poisson": rng.choice([0.47, 0.49])},
        "inclusion": inside,
        "indenter": {"shape": "cylinder", "radius_mm": rng.uniform(3, 6), "length_mm": 10.0},
        "pulse": {"wave": "brachial", "rate_bpm": rng.uniform(50, 110),
                  "systolic_mmhg": rng.uniform(110, 140), "diastolic_mmhg": rng.uniform(60, 90)},
    }  # fmt: skip
    sensor = {"driver": "virtual", "rate_hz": float(rng.choice([50, 125, 500])),
              "noise_mn": float(rng.choice([0.2, 0.5, 1.0]))}  # fmt: skip
    rig = {
        "sensor": [sensor],
        "scan": {"start_mm": [x_mm[0], y_mm[0]], "pitch_mm": [pitch, apart],
                 "stations": [columns, rows],
                 "indentation_mm": rng.uniform(1.5, 2.5), "approach_mm_s": 5.0, "ramp_s": 0.5,
                 "hold_s": float(rng.choice([0.9, 1.3, 1.7, 2.5, 4.0]))},
        "safety": {"max_force_n": 8.0, "max_speed_mm_s": 25.0,
                   "workspace_mm": {"x": [-5, 90], "y": [-20, 30], "z": [-4.5, 50]}},
    }  # fmt: skip
    return truth, scene, rig


def judge(seed: int) -> Row:
    """One grid's finding beside the truth."""
    truth, scene, rig = drawn(seed)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.toml"
        file.write_text(tomli_w.dumps(_plain(scene)))
        path = palpate.scan(Rig.model_validate(_plain(rig)), file, folder, seed=seed).path
        found = palpate.detect(path)
    best = max(found.objects, key=lambda one: one.confidence, default=None)
    answer: dict[str, object] = {
        "truth": truth, "found": found.finding, "rows": rig["scan"]["stations"][1],
        "confidence": "" if best is None else f"{best.confidence:.4f}",
        "hold_s": rig["scan"]["hold_s"], "rate_hz": rig["sensor"][0]["rate_hz"],
    }  # fmt: skip
    if best is None or not best.course or not scene["inclusion"]:
        return answer
    there = scene["inclusion"][0]
    _, y_m = min(best.course, key=lambda at: abs(at[0] - best.position_m))
    path = np.array(there.get("path", [[0.0, there["x_mm"]]]))
    true_mm = np.interp(1e3 * y_m, path[:, 0], path[:, 1])
    low, high = best.position_ci_mm
    answer["place"] = bool(low <= true_mm <= high)
    if best.stenosed_m is not None:
        first_mm, apart_mm = rig["scan"]["start_mm"][1], rig["scan"]["pitch_mm"][1]
        rows_mm = first_mm + apart_mm * np.arange(rig["scan"]["stations"][1])
        answer["stretch"] = bool(np.array_equal(
            _within(rows_mm, there["stenosis"]["z_mm"]) if "stenosis" in there else [],
            _within(rows_mm, 1e3 * np.array(best.stenosed_m)),
        ))  # fmt: skip
    return answer


def _within(rows_mm: Array, ends_mm: Sequence[float]) -> Array:
    """Which rows lie between both ends."""
    return np.flatnonzero((rows_mm > ends_mm[0] - 0.05) & (rows_mm < ends_mm[1] + 0.05))


def _plain(value: Any) -> Any:
    """Python's own numbers, for a file."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return value.item() if isinstance(value, np.generic) else value


def main(grids: int = 100) -> None:
    """Judge, and tell what is kept."""
    rows = fill(OUT, ("seed",), ANSWERS, [(seed,) for seed in range(grids)], judge)
    for truth in KINDS:
        said = [row["found"] for row in rows if row["truth"] == truth]
        print(
            f"{truth}: " + ", ".join(f"{said.count(what)} {what}" for what in dict.fromkeys(said))
        )
    for what in ("place", "stretch"):
        known = [row[what] == "True" for row in rows if row[what]]
        print(f"{what}: right in {sum(known)} of {len(known)}, {exact(sum(known), len(known))} %")


if __name__ == "__main__":
    run(main)
