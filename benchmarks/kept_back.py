"""Scenes that nothing was tuned on, by `press` and by CalculiX from its own deck.

    python benchmarks/kept_back.py [SCENE ...]

CalculiX gets our mesh but has its own elements, contact and Newton method. Where it stops on one
mesh, another is tried. Prints force and its change with pressure by both; minutes a scene.
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

import pandas as pd

from sim_backend.fem.io.deck import ccx_forces_n_per_mm, write_deck
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene

SIZES_MM = (1.2, 0.9, 0.7)
LIMIT_S = 1500.0
TISSUE = {"width_mm": 64.0, "height_mm": 16.83, "modulus_kpa": 50.0, "poisson": 0.49}
ROUND = {"shape": "cylinder", "radius_mm": 5.0, "length_mm": 10.0}
FLAT = {"shape": "flat", "width_mm": 8.0, "edge_radius_mm": 1.0, "length_mm": 10.0}


def artery(
    x_mm: float = 32.0, depth_mm: float = 12.66, modulus_kpa: float = 400.0
) -> dict[str, Any]:
    """A vessel as the paper's, elsewhere or of another wall."""
    return {"kind": "artery", "x_mm": x_mm, "depth_mm": depth_mm, "inner_diameter_mm": 4.5,
            "wall_mm": 0.63, "modulus_kpa": modulus_kpa, "poisson": 0.49}  # fmt: skip


def tumour(x_mm: float, depth_mm: float, modulus_kpa: float) -> dict[str, Any]:
    """A lump 4.5 mm across."""
    return {"kind": "tumour", "x_mm": x_mm, "depth_mm": depth_mm, "diameter_mm": 4.5,
            "modulus_kpa": modulus_kpa, "poisson": 0.49}  # fmt: skip


def case(
    inclusion: list[dict[str, Any]], x_mm: float = 32.0, depth_mm: float = 2.5,
    finger: dict[str, Any] = ROUND, plane: str = "stress", modulus_kpa: float = 50.0,
) -> tuple[Scene, float, float]:  # fmt: skip
    """A scene, x and depth [mm]."""
    raw = {"name": "kept back", "plane": plane, "tissue": TISSUE | {"modulus_kpa": modulus_kpa},
           "inclusion": inclusion, "indenter": finger,
           "pulse": {"wave": "paper", "rate_bpm": 72.0}}  # fmt: skip
    return Scene.model_validate(raw), x_mm, depth_mm


CASES = {
    "off-centre": case([artery(x_mm=23.0)], x_mm=26.0),
    "shallow": case([artery(depth_mm=6.5)], depth_mm=1.5),
    "two inclusions": case([artery(x_mm=36.0), tumour(27.0, 6.0, 1000.0)], x_mm=31.0),
    "100:1 contrast": case([tumour(32.0, 7.0, 5000.0), artery(x_mm=40.0)], x_mm=34.0),
    "soft tissue": case([artery(modulus_kpa=300.0)], modulus_kpa=10.0),
    "flat finger": case([artery()], depth_mm=1.5, finger=FLAT),
    "plane strain": case([artery(x_mm=30.0, depth_mm=9.0)], plane="strain"),
    "4 mm deep": case([artery()], depth_mm=4.0),
}
LEVELS_MMHG = (80.0, 120.0)


def by_calculix(scene: Scene, x_mm: float, depth_mm: float) -> tuple[list[float], float, float]:
    """Forces [N/mm], seconds by CalculiX and its element size [mm]; none where it always stops."""
    for size_mm in SIZES_MM:
        with tempfile.TemporaryDirectory() as folder:
            deck = write_deck(scene, x_mm, depth_mm, LEVELS_MMHG, Path(folder) / "press.inp",
                              size_mm=size_mm)  # fmt: skip
            began = children_s()
            try:
                subprocess.run(["ccx", "-i", deck.stem], cwd=folder, capture_output=True,
                               timeout=LIMIT_S, check=False)  # fmt: skip
            except subprocess.TimeoutExpired:
                continue
            spent = children_s() - began
            forces = ccx_forces_n_per_mm(deck) if deck.with_suffix(".dat").exists() else []
        if len(forces) == len(LEVELS_MMHG):
            return forces, spent, size_mm
    return [], float("nan"), float("nan")


def children_s() -> float:
    """Seconds of the processor that finished children took."""
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print one row per scene."""
    rows = []
    for name in sys.argv[1:] or CASES:
        scene, x_mm, depth_mm = CASES[name]
        began = process_time()
        pressed = press(scene, x_mm, depth_mm, LEVELS_MMHG)
        row: dict[str, Any] = {"scene": name, "seconds": process_time() - began}
        low, high = (state.force_n_per_mm for state in pressed.states)
        row |= {"N/mm": low, "change N/mm": high - low, "stated %": pressed.error_estimate_pct}
        theirs, seconds, size_mm = by_calculix(scene, x_mm, depth_mm)
        if theirs:
            row |= {
                "force off %": 100 * (low / theirs[0] - 1),
                "change off %": 100 * ((high - low) / (theirs[1] - theirs[0]) - 1),
                "CalculiX s": seconds,
                "its size mm": size_mm,
            }
        rows.append(row)
        print(row, flush=True)
    print(pd.DataFrame(rows).to_string(index=False, float_format="%.4g"))


if __name__ == "__main__":
    main()
