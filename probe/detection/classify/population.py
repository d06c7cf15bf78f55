"""The population that kinds are judged by: random vessels and lumps, in tissue and out of it.

``python -m probe.detection.classify.population FILE EACH`` solves ``EACH`` samples of every
stratum, and goes on where the file ends. A sample is the contrast (force over an object
against the same block with nothing in it, less 1; NaN out of tissue), the pulse (change of force by
a beat over the force) and the apparent modulus [Pa].
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drivers.core.arrays import Array
from probe.detection.finding import HEALTHY, LUMP, NARROWED, Kind

SEED = 20
FINGER_LENGTH_MM, MIDDLE_MM = 10.0, 32.0
DRAWS: Mapping[str, tuple[float, float]] = {
    "height_mm": (10.0, 25.0),
    "tissue_kpa": (10.0, 100.0),
    "finger_mm": (3.0, 8.0),
    "sunk": (0.08, 0.18),  # indentation over the block's height
    "sunk_alone": (0.2, 0.5),  # over the outer diameter of a vessel out of tissue
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
OFF_CENTRE = 0.05
"""Of the outer diameter: how far the finger misses a lone vessel's middle. Exactly above it, a soft
vessel in plane stress can stand on an unstable branch."""


World = Literal["above", "beside", "alone"]
WORLDS: tuple[World, ...] = ("above", "beside", "alone")
"""A press right above what lies in tissue, up to `BESIDE_MM` beside it, and on a vessel out of
tissue."""
BESIDE_MM = 12.0


@dataclass(frozen=True)
class Stratum:
    """A part of a ``kind``: its ``share`` of the kind, and what it ``draws`` otherwise than
    `DRAWS`. ``stiff``: its vessels give way less than healthy ones."""

    kind: Kind
    share: float = 1.0
    stiff: bool = False
    draws: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def beats(self) -> bool:
        return self.kind != LUMP


STRATA: Mapping[str, Stratum] = {
    "lump": Stratum(LUMP),
    "artery": Stratum(HEALTHY, 0.8),
    "calcified artery": Stratum(HEALTHY, 0.2, stiff=True, draws={"vessel_kpa": (1000.0, 6000.0)}),
    "stenosis": Stratum(NARROWED, 0.9, stiff=True),
    "soft stenosis": Stratum(NARROWED, 0.1, draws={"fraction": (0.1, 0.5), "plaque": (0.2, 3.0)}),
}
"""By name. A fifth of open vessels are calcified (of 650 people without complaints a third had
calcium in a carotid: Allison, Criqui & Wright 2004) and a tenth of narrowings mild or of lipid: one
press or row hardly tells the former from a stenosis and the latter from none, and no kind may be
surer than that."""


def samples() -> dict[tuple[str, World], Array]:
    """By stratum and world: (n, 3) contrast, pulse and apparent modulus [Pa]."""
    with (resources.files("probe.detection.classify") / "population.npz").open("rb") as file:
        table = np.load(file, allow_pickle=False)
        return {key: table[" ".join(key)] for key in _every()}


def _every() -> list[tuple[str, World]]:
    return [
        (name, world) for name, stratum in STRATA.items() for world in WORLDS
        if stratum.beats or world != "alone"
    ]  # fmt: skip


def apparent_modulus_pa(level_pa: float, face_m2: float, depth_m: float) -> float:
    """Force over depth and the root of the face: what a press says of stiffness by itself."""
    return float(level_pa * np.sqrt(face_m2) / depth_m)


def solve(file: Path, each: int) -> None:
    """Draw and solve until there are ``each`` of every stratum in every world; those that cannot be
    solved are drawn again."""
    solved = {" ".join(key): np.empty((0, 3)) for key in _every()}
    drawn = 0
    if file.exists():
        with np.load(file, allow_pickle=False) as table:
            drawn, solved = int(table["drawn"]), {name: table[name] for name in solved}
    while min(len(rows) for rows in solved.values()) < each:
        for number, (stratum, world) in enumerate(_every()):
            key = f"{stratum} {world}"
            if len(solved[key]) < each:
                rng = np.random.default_rng([SEED, number, drawn])
                sample = _sample(STRATA[stratum], world, rng)
                solved[key] = np.vstack([solved[key], *([sample] if sample else [])])
        drawn += 1
        np.savez(file, drawn=np.array(drawn), **solved)  # type: ignore[arg-type]


def _sample(
    stratum: Stratum, world: World, rng: np.random.Generator
) -> tuple[float, float, float] | None:
    """One of a stratum; None where it has no room or cannot be solved."""
    from sim_backend.fem.finite_strain import solve_finite
    from sim_backend.fem.newton import CannotSolve
    from sim_backend.scene.scene_file import Scene
    from sim_backend.scene.waves import PA_PER_MMHG

    ranges = {**DRAWS, **stratum.draws}
    drawn = {key: float(np.exp(rng.uniform(*np.log(ends)))) for key, ends in ranges.items()}
    radius_mm = drawn["inner_mm"] * (0.5 + drawn["wall"])
    low, high = radius_mm + 1.5, drawn["height_mm"] - radius_mm - 0.5
    where, beside_mm = rng.uniform(), rng.uniform(0.0, BESIDE_MM)
    if world == "alone":
        file = _scene(stratum.kind, drawn, radius_mm)
        del file["tissue"]
        aside_mm, sunk_mm = 2 * OFF_CENTRE * radius_mm, 2 * drawn["sunk_alone"] * radius_mm
        size_mm = 0.5 * drawn["finger_mm"]
    elif low < high:
        file = _scene(stratum.kind, drawn, low + where * (high - low))
        aside_mm = beside_mm if world == "beside" else 0.0
        sunk_mm, size_mm = drawn["sunk"] * drawn["height_mm"], 0.2 * drawn["finger_mm"]
    else:
        return None
    scene = Scene.model_validate(file)
    diastolic_pa = drawn["diastolic_mmhg"] * PA_PER_MMHG
    pressures_pa = [diastolic_pa, diastolic_pa + drawn["swing_mmhg"] * PA_PER_MMHG]
    pressed_m = 1e-3 * (MIDDLE_MM + aside_mm), 1e-3 * sunk_mm

    def force_n_per_m(of: Scene, pressures: list[float]) -> list[float]:
        states = solve_finite(of, *pressed_m, pressures, 1e-3 * size_mm)[1]
        return [state.force_n_per_m for state in states]

    try:
        first, *_, last = 2 * force_n_per_m(scene, pressures_pa if stratum.beats else [0.0])
        empty = float("nan")
        if scene.tissue is not None:
            (empty,) = force_n_per_m(scene.model_copy(update={"inclusion": ()}), [0.0])
    except CannotSolve:
        return None
    rest = first + (last - first) / 3  # a wave is low for most of a beat
    if rest <= 0:
        return None
    width_m = 2e-3 * drawn["finger_mm"]
    face_m2 = 1e-3 * FINGER_LENGTH_MM * width_m
    modulus_pa = apparent_modulus_pa(rest / width_m, face_m2, pressed_m[1])
    return rest / empty - 1, (last - first) / rest, modulus_pa


def _scene(kind: Kind, drawn: Mapping[str, float], depth_mm: float) -> dict[str, Any]:
    place = {"x_mm": MIDDLE_MM, "depth_mm": depth_mm, "poisson": 0.49}
    if kind == LUMP:
        size = {"kind": "tumour", "diameter_mm": drawn["inner_mm"] * (1 + 2 * drawn["wall"])}
        body = place | size | {"modulus_kpa": drawn["lump"] * drawn["tissue_kpa"]}
    else:
        wall_mm = drawn["wall"] * drawn["inner_mm"]
        body = place | {
            "kind": "artery", "inner_diameter_mm": drawn["inner_mm"], "wall_mm": wall_mm,
            "modulus_kpa": drawn["vessel_kpa"],
        }  # fmt: skip
    if kind == NARROWED:
        stiff_kpa = drawn["plaque"] * drawn["vessel_kpa"]
        body["stenosis"] = {"fraction": drawn["fraction"], "modulus_kpa": stiff_kpa}
    return {
        "name": kind,
        "tissue": {
            "width_mm": 2 * MIDDLE_MM, "height_mm": drawn["height_mm"],
            "modulus_kpa": drawn["tissue_kpa"], "poisson": 0.49,
        },
        "inclusion": [body],
        "indenter": {"shape": "cylinder", "radius_mm": drawn["finger_mm"]},
    }  # fmt: skip


if __name__ == "__main__":
    solve(Path(sys.argv[1]), int(sys.argv[2]))
