"""What one press shows of a vessel: solved ones in tissue and out of it, by pulse and stiffness.

``python -m probe.detection.classify.single_press FILE SAMPLES`` solves them again, and goes on
where the file ends. A sample is the pulse, change of force by a beat over the force, and the
apparent modulus, force over depth and the root of the probe's face. Out of tissue a vessel is far
stiffer under the finger than its pulse would let it be in tissue.
"""

import sys
from importlib import resources
from pathlib import Path

import numpy as np

from drivers.core.arrays import Array
from probe.detection.classify.population import DRAWS, between, scene_of
from probe.detection.finding import Kind

VESSELS: tuple[Kind, ...] = ("artery", "stenotic artery")
WORLDS = ("tissue", "alone")
SEED = 21
LONE_SUNK = (0.2, 0.5)
"""Indentation of a vessel out of tissue over its outer diameter."""
OFF_CENTRE = 0.05
"""Of the outer diameter: how far the finger misses a lone vessel's middle. Exactly above it, a soft
vessel in plane stress can stand on an unstable branch."""
FINGER_LENGTH_MM = 10.0


def vessels() -> dict[str, dict[Kind, Array]]:
    """By world and kind: (n, 2) pulse over force, and apparent modulus [Pa]."""
    with (resources.files("probe.detection.classify") / "single_press.npz").open("rb") as file:
        table = np.load(file, allow_pickle=False)
        return {world: {kind: table[_key(world, kind)] for kind in VESSELS} for world in WORLDS}


def apparent_modulus_pa(level_pa: float, face_m2: float, depth_m: float) -> float:
    """Force over depth and the root of the face: what a press says of stiffness by itself."""
    return float(level_pa * np.sqrt(face_m2) / depth_m)


def _key(world: str, kind: str) -> str:
    return f"{world}_{kind.replace(' ', '_')}"


def solve(file: Path, each: int) -> None:
    """Draw and solve until there are ``each`` of every world and kind; keep them as they come."""
    found = {_key(w, k): np.empty((0, 2)) for w in WORLDS for k in VESSELS}
    begun = 0
    if file.exists():
        with np.load(file, allow_pickle=False) as table:
            begun = int(table["begun"])
            found = {key: table[key] for key in found}
    while min(len(rows) for rows in found.values()) < each:
        for number, (world, kind) in enumerate((w, k) for w in WORLDS for k in VESSELS):
            rng = np.random.default_rng([SEED, number, begun])
            answer = _one(world, kind, rng)
            key = _key(world, kind)
            if answer is not None and len(found[key]) < each:
                found[key] = np.vstack([found[key], answer])
        begun += 1
        np.savez(file, begun=np.array(begun), **found)  # type: ignore[arg-type]


def _one(world: str, kind: str, rng: np.random.Generator) -> tuple[float, float] | None:
    from sim_backend.fem.finite_strain import solve_finite
    from sim_backend.fem.newton import CannotSolve
    from sim_backend.scene.scene_file import Scene
    from sim_backend.scene.waves import PA_PER_MMHG

    v = {k: between(rng, *pair) for k, pair in (DRAWS | {"lone_sunk": LONE_SUNK}).items()}
    outer_mm = v["inner_mm"] * (1 + 2 * v["wall"])
    low, high = outer_mm / 2 + 1.5, v["height_mm"] - outer_mm / 2 - 0.5
    where = rng.uniform()
    if world == "alone":
        whole = scene_of(kind, v, outer_mm / 2)
        scene = Scene.model_validate({k: part for k, part in whole.items() if k != "tissue"})
        x_mm, depth_mm = 32.0 + OFF_CENTRE * outer_mm, v["lone_sunk"] * outer_mm
        size_mm = 0.5 * v["finger_mm"]
    elif low < high:
        scene = Scene.model_validate(scene_of(kind, v, low + where * (high - low)))
        x_mm, depth_mm, size_mm = 32.0, v["sunk"] * v["height_mm"], 0.2 * v["finger_mm"]
    else:
        return None
    diastolic = v["diastolic_mmhg"] * PA_PER_MMHG
    levels = [diastolic, diastolic + v["swing_mmhg"] * PA_PER_MMHG]
    try:
        solved = solve_finite(scene, 1e-3 * x_mm, 1e-3 * depth_mm, levels, 1e-3 * size_mm)[1]
    except CannotSolve:
        return None
    first, last = solved[0].force_n_per_m, solved[-1].force_n_per_m
    rest = first + (last - first) / 3  # a wave is low for most of a beat
    if rest <= 0:
        return None
    face_m2 = 2e-6 * v["finger_mm"] * FINGER_LENGTH_MM
    level_pa = rest / (2e-3 * v["finger_mm"])
    return (last - first) / rest, apparent_modulus_pa(level_pa, face_m2, 1e-3 * depth_mm)


if __name__ == "__main__":
    solve(Path(sys.argv[1]), int(sys.argv[2]))
