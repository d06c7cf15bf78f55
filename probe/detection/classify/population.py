"""The population that kinds are judged by: random vessels and lumps, solved.

``python -m probe.detection.classify.population FILE`` solves it again (about 10 minutes on one
core). A sample is the contrast,
force over an object against the same block with nothing in it, less 1, and the pulse, change of
force by a beat over the force.
"""

import sys
from importlib import resources
from typing import Any

import numpy as np

from drivers.core.arrays import Array
from probe.detection.finding import Kind

KINDS: tuple[Kind, ...] = ("tumour", "artery", "stenotic artery")
EACH = 250
SEED = 20
DRAWS: dict[str, tuple[float, float]] = {
    "height_mm": (10.0, 25.0),
    "tissue_kpa": (10.0, 100.0),
    "finger_mm": (3.0, 8.0),
    "sunk": (0.08, 0.18),  # indentation over the block's height
    "inner_mm": (2.0, 6.0),
    "wall": (0.08, 0.18),  # over the inner diameter
    "vessel_kpa": (200.0, 1000.0),
    "fraction": (0.2, 0.6),
    "plaque": (3.0, 20.0),  # over the vessel's modulus
    "lump": (4.0, 40.0),  # over the tissue's
    "diastolic_mmhg": (60.0, 95.0),
    "swing_mmhg": (30.0, 60.0),
}
"""Ranges, drawn evenly in the logarithm."""


def samples() -> dict[Kind, Array]:
    """By kind: (n, 2) contrast and pulse."""
    with (resources.files("probe.detection.classify") / "population.npz").open("rb") as file:
        table = np.load(file, allow_pickle=False)
        return {kind: table[kind.replace(" ", "_")] for kind in KINDS}


def solve(each: int = EACH) -> dict[Kind, Array]:
    """Draw and solve ``each`` scenes of every kind; those that cannot be are drawn again."""
    rng = np.random.default_rng(SEED)
    found: dict[Kind, list[tuple[float, float]]] = {kind: [] for kind in KINDS}
    for kind in KINDS:
        while len(found[kind]) < each:
            answer = _one(kind, {k: between(rng, *v) for k, v in DRAWS.items()}, rng.uniform())
            if answer is not None:
                found[kind].append(answer)
    return {kind: np.array(values) for kind, values in found.items()}


def between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _one(kind: str, v: dict[str, float], where: float) -> tuple[float, float] | None:
    from sim_backend.fem.finite_strain import solve_finite
    from sim_backend.fem.newton import CannotSolve
    from sim_backend.scene.scene_file import Scene
    from sim_backend.scene.waves import PA_PER_MMHG

    radius = v["inner_mm"] * (0.5 + v["wall"])
    low, high = radius + 1.5, v["height_mm"] - radius - 0.5
    if low >= high:
        return None
    scene = Scene.model_validate(scene_of(kind, v, low + where * (high - low)))
    depth_m = 1e-3 * v["sunk"] * v["height_mm"]
    size_m = 0.2e-3 * v["finger_mm"]
    diastolic = v["diastolic_mmhg"] * PA_PER_MMHG
    systolic = diastolic + v["swing_mmhg"] * PA_PER_MMHG
    levels = [diastolic, systolic] if scene.arteries else [0.0]
    plain = scene.model_copy(update={"inclusion": ()})
    try:
        force = [s.force_n_per_m for s in solve_finite(scene, 0.032, depth_m, levels, size_m)[1]]
        empty = solve_finite(plain, 0.032, depth_m, [0.0], size_m)[1][0].force_n_per_m
    except CannotSolve:
        return None
    rest = force[0] + (force[-1] - force[0]) / 3  # a wave is low for most of a beat
    return rest / empty - 1, (force[-1] - force[0]) / rest


def scene_of(kind: str, v: dict[str, float], depth_mm: float) -> dict[str, Any]:
    place = {"x_mm": 32.0, "depth_mm": depth_mm, "poisson": 0.49}
    if kind == "tumour":
        size = {"kind": "tumour", "diameter_mm": v["inner_mm"] * (1 + 2 * v["wall"])}
        one = place | size | {"modulus_kpa": v["lump"] * v["tissue_kpa"]}
    else:
        wall = {"inner_diameter_mm": v["inner_mm"], "wall_mm": v["wall"] * v["inner_mm"]}
        one = place | wall | {"kind": "artery", "modulus_kpa": v["vessel_kpa"]}
    if kind == "stenotic artery":
        stiff = v["plaque"] * v["vessel_kpa"]
        one = one | {"stenosis": {"fraction": v["fraction"], "modulus_kpa": stiff}}
    return {
        "name": kind,
        "tissue": {
            "width_mm": 64.0,
            "height_mm": v["height_mm"],
            "modulus_kpa": v["tissue_kpa"],
            "poisson": 0.49,
        },
        "inclusion": [one],
        "indenter": {"shape": "cylinder", "radius_mm": v["finger_mm"]},
    }


if __name__ == "__main__":
    np.savez(sys.argv[1], **{k.replace(" ", "_"): v for k, v in solve().items()})  # type: ignore[arg-type]
