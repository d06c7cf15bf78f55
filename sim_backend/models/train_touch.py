"""Make a `TouchTable`: presses at random places over random bodies, and least squares.

Each press is solved at a few depths, over a vessel at diastole and systole, with the exact
derivatives of its force by every number of its scene.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.newton import CannotSolve
from sim_backend.fem.sensitivity import gradients
from sim_backend.models.place import place
from sim_backend.models.solved import Solved
from sim_backend.scene.numbers import numbers
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG
from sim_backend.touch.basis import Basis
from sim_backend.touch.kinds import KINDS, LUMP, VESSEL, Kind
from sim_backend.touch.table import Ratios, TouchTable, about_block

SUNK = np.array([0.1, 0.2, 0.35, 0.5])
"""Depths that are solved, over the finger's half width."""
PRESSES = {"lump": 600, "vessel": 900}
"""With half as many a table of lumps misses 1.3 times as much, with twice as many 0.9 times."""
BARE_PLACES = 24
WEIGHT_OF_SLOPES = 0.3
"""Of a slope times its parameter's spread, beside a value; 0.1 and 1 fit lumps alike."""
RIDGE = 1e-7
"""Of the mean of the normal equations' diagonal, times one plus the square of a term's degree."""
HELD_OUT = 5
"""Every fifth press is not trained on, but says what the table is off by."""
STEP = 1e-5
ASIDE = 1.7
"""Exponent by which places crowd about a body, where its bump is."""


class Samples(NamedTuple):
    """Solved states over a kind of body: where (n,), how deep (n,) and over what (n, p); the
    force of the bare block there (n,); bump and pulse over that (n, 2), and their derivatives
    (p + 1, n, 2) by each parameter and by depth, NaN where unknown. ``press`` (n,) numbers the
    presses, of each of which several depths are solved."""

    x: Array
    sunk: Array
    theta: Array
    bare: Array
    value: Array
    slope: Array
    press: Array

    def where(self, chosen: Array) -> "Samples":
        return Samples(
            self.x[chosen], self.sunk[chosen], self.theta[chosen], self.bare[chosen],
            self.value[chosen], self.slope[:, chosen], self.press[chosen],
        )  # fmt: skip


def touch_table(
    block: Scene, seed: int = 0, solving: Callable[[str, int, int], None] | None = None
) -> TouchTable:
    """The table of a plane ``block`` of tissue, under its finger; what lies in it does not matter.

    ``solving`` hears of each press: which kind, how many are solved, of how many. Raises
    `CannotSolve` where even the bare block cannot be pressed.
    """
    bare = block.model_copy(update={"inclusion": ()})
    units = Units(bare)
    middle = np.linspace(0.0, units.half_width - 0.4, BARE_PLACES)
    force = np.array([
        [solved.force_n_per_m[0] for solved in ramp(bare, units.place_m(x))] for x in middle
    ]) / units.force_n_per_m  # fmt: skip
    table = TouchTable(about_block(bare), SUNK, middle, force.T, {})
    rng = np.random.default_rng(seed)
    ratios = {
        kind.name: trained(kind, _samples(kind, units, table, rng, solving)) for kind in KINDS
    }
    return replace(table, ratios=ratios)


class Units:
    """Of finger, tissue and block: what a table's numbers are over."""

    def __init__(self, bare: Scene) -> None:
        assert bare.tissue is not None
        self.bare, self.tissue = bare, bare.tissue
        self.length_mm = bare.indenter.width_mm_projected / 2
        self.force_n_per_m = 1e3 * self.tissue.modulus_kpa * 1e-3 * self.length_mm
        self.half_width = self.tissue.width_mm / 2 / self.length_mm
        self.height = self.tissue.height_mm / self.length_mm

    def place_m(self, x: float) -> float:
        return 1e-3 * (self.tissue.width_mm / 2 + x * self.length_mm)

    def scene(self, kind: Kind, theta: Array) -> Scene:
        """The block with a body in it; pressures are the wave's ends."""
        of = dict(zip(kind.parameters, (float(one) for one in theta), strict=True))
        modulus_kpa, length_mm = self.tissue.modulus_kpa, self.length_mm
        body = {
            "x_mm": self.tissue.width_mm / 2 + of["x"] * length_mm,
            "depth_mm": of["depth"] * length_mm,
            "modulus_kpa": np.exp(of["log_ratio"]) * modulus_kpa,
            "poisson": self.tissue.poisson,
        }
        update: dict[str, object] = {}
        if kind is LUMP:
            body |= {"kind": "tumour", "diameter_mm": np.exp(of["log_diameter"]) * length_mm}
        else:
            inner_mm = np.exp(of["log_inner"]) * length_mm
            body |= {
                "kind": "artery", "inner_diameter_mm": inner_mm,
                "wall_mm": np.exp(of["log_wall"]) * inner_mm,
            }  # fmt: skip
            if of["narrowing"] > 0:
                body["stenosis"] = {
                    "fraction": of["narrowing"],
                    "modulus_kpa": np.exp(of["log_plaque"]) * body["modulus_kpa"],
                }
            mmhg = 1e3 * modulus_kpa / PA_PER_MMHG
            update["pulse"] = {
                "diastolic_mmhg": of["pressure"] * mmhg,
                "systolic_mmhg": (of["pressure"] + of["swing"]) * mmhg,
            }
        file = self.bare.model_dump(exclude_none=True) | update | {"inclusion": [body]}
        return Scene.model_validate(file)


def _samples(
    kind: Kind, units: Units, table: TouchTable, rng: np.random.Generator,
    solving: Callable[[str, int, int], None] | None,
) -> Samples:  # fmt: skip
    found: list[Samples] = []
    count = PRESSES[kind.name]
    low, high = np.array(kind.low), np.array(kind.high)
    while len(found) < count:
        theta = low + (high - low) * rng.random(len(low))
        if kind is VESSEL and rng.random() < 0.5:
            theta[kind.parameters.index("narrowing")] = 0.0
        x = theta[0] + 6 * np.sign(rng.random() - 0.5) * rng.random() ** ASIDE
        if not kind.fits(theta[None], units.height)[0] or abs(x) > units.half_width - 0.4:
            continue
        try:
            found.append(_sample(kind, units, table, theta, x, len(found)))
        except (CannotSolve, ValueError):  # no room, or beyond what can be solved
            continue
        if solving is not None:
            solving(kind.name, len(found), count)
    return Samples(*(
        np.concatenate(parts, axis=1 if name == "slope" else 0)
        for name, parts in zip(Samples._fields, zip(*found, strict=True), strict=True)
    ))  # fmt: skip


def _sample(
    kind: Kind, units: Units, table: TouchTable, theta: Array, x: float, number: int
) -> Samples:
    """One press at all depths."""
    scene = units.scene(kind, theta)
    keys, by_theta = _numbers_by_theta(kind, units, theta)
    places = np.full(len(SUNK), x)
    bare = table.bare_force(places, SUNK)
    bare_slope = (table.bare_force(places, SUNK + STEP) - table.bare_force(places, SUNK - STEP)) / (
        2 * STEP
    )
    force, slope = np.zeros((2, len(SUNK))), np.zeros((2, len(theta) + 1, len(SUNK)))
    unit = units.force_n_per_m
    for k, solved in enumerate(ramp(scene, units.place_m(x))):
        for end, state in enumerate(solved.states[: 1 + kind.beats]):
            force[end, k] = state.force / unit
            by = gradients(solved.body, state, scene, [*keys, "depth_mm", *_pressed(kind)])
            slope[end, :-1, k] = by_theta @ np.array([by[key] for key in keys]) / unit
            slope[end, -1, k] = by["depth_mm"] * units.length_mm / unit
            if kind.beats:
                mmhg = 1e3 * units.tissue.modulus_kpa / PA_PER_MMHG
                for name in ("pressure", "swing")[: 1 + end]:
                    at = kind.parameters.index(name)
                    slope[end, at, k] += by["pressure_mmhg"] * mmhg / unit
    pulse = force[1] - force[0] if kind.beats else np.zeros(len(SUNK))
    by_pulse = slope[1] - slope[0] if kind.beats else np.zeros_like(slope[0])
    value = np.stack([force[0] / bare - 1, pulse / bare], axis=1)
    by_value = np.stack([slope[0] / bare, by_pulse / bare], axis=2)
    by_value[-1] -= (np.stack([force[0], pulse], axis=1) * bare_slope[:, None]) / bare[:, None] ** 2
    if kind is VESSEL and theta[kind.parameters.index("narrowing")] == 0:
        by_value[kind.parameters.index("narrowing")] = np.nan  # a ring of no thickness has no mesh
    return Samples(
        places, SUNK, np.tile(theta, (len(SUNK), 1)), bare, value, by_value,
        np.full(len(SUNK), number),
    )  # fmt: skip


def _pressed(kind: Kind) -> tuple[str, ...]:
    return ("pressure_mmhg",) if kind.beats else ()


def _numbers_by_theta(kind: Kind, units: Units, theta: Array) -> tuple[list[str], Array]:
    """Keys of the body's numbers, and their derivatives (p, k) by the kind's parameters."""
    here = numbers(units.scene(kind, theta))
    keys = [key for key in here if key.startswith("inclusion.0") and not key.endswith("poisson")]
    rows = []
    for k in range(len(theta)):
        step = np.zeros(len(theta))
        step[k] = STEP * (1 if kind.parameters[k] != "narrowing" or theta[k] > 0 else 0)
        ahead, behind = (numbers(units.scene(kind, theta + s * step)) for s in (1, -1))
        rows.append([(ahead[key] - behind[key]) / (2 * STEP) for key in keys])
    return keys, np.array(rows)


def ramp(scene: Scene, x_m: float) -> list[Solved]:
    """At each depth the state at diastole and at systole."""
    depths_m = SUNK * 0.5e-3 * scene.indenter.width_mm_projected
    beat = scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg
    return place(scene, x_m).ramp(depths_m.tolist(), [PA_PER_MMHG * p for p in beat])


def trained(kind: Kind, samples: Samples) -> Ratios:
    """Least squares on values and derivatives; the error is that of the presses held out."""
    held_out = samples.press % HELD_OUT == 0
    test = samples.where(held_out)
    ratios = _fit(kind, samples.where(~held_out))
    central = kind.central(test.theta)
    off = (ratios(test.x, test.sunk, test.theta) - test.value) / np.where(central, central, 1.0)
    return replace(_fit(kind, samples), error=np.sqrt((off**2).mean(axis=0)))


def _fit(kind: Kind, samples: Samples) -> Ratios:
    x, sunk, theta, bare, value, slope, _ = samples
    coordinates = kind.coordinates(x, sunk, theta)
    low, high = coordinates.min(axis=0), coordinates.max(axis=0)
    basis = Basis(coordinates.shape[1], kind.degree)
    scaled = 2 * (coordinates - low) / (high - low) - 1
    terms = basis.values(scaled)
    by_coordinate = basis.derivatives(scaled) * (2 / (high - low))[:, None, None]
    turned = _slopes(kind.coordinates, x, sunk, theta)
    size = kind.size(x, theta)
    turned_size = _slopes(lambda x, _, theta: kind.size(x, theta), x, sunk, theta)
    spread = np.append(theta.std(axis=0), sunk.std())
    coefficients = np.zeros((terms.shape[1], 2))
    for output in range(1 + kind.beats):
        ratio = value[:, output] / size[:, output]
        weight = np.sqrt(size[:, output] * bare)  # small bumps need not be known as well
        rows, wanted = [terms * weight[:, None]], [ratio * weight]
        for k, one_turned in enumerate(turned):
            along = (slope[k, :, output] - ratio * turned_size[k, :, output]) / size[
                :, output
            ]  # the quotient's rule
            known = np.isfinite(along)
            scale = WEIGHT_OF_SLOPES * spread[k] * weight[known]
            row = np.einsum("nc,cnt->nt", one_turned[known], by_coordinate[:, known])
            rows.append(row * scale[:, None])
            wanted.append(along[known] * scale)
        matrix, right = np.vstack(rows), np.concatenate(wanted)
        normal = matrix.T @ matrix
        ridge = RIDGE * np.trace(normal) / len(normal)
        normal += ridge * np.diag(1.0 + basis.exponents.sum(axis=1) ** 2)
        coefficients[:, output] = np.linalg.solve(normal, matrix.T @ right)
    return Ratios(kind, low, high, coefficients, np.zeros(2))


def _slopes(
    function: Callable[[Array, Array, Array], Array], x: Array, sunk: Array, theta: Array
) -> Array:
    """Derivatives (p + 1, n, outputs) by parameters and depth, by central differences."""
    found = []
    for k in range(theta.shape[1]):
        step = STEP * np.eye(theta.shape[1])[k]
        found.append(function(x, sunk, theta + step) - function(x, sunk, theta - step))
    found.append(function(x, sunk + STEP, theta) - function(x, sunk - STEP, theta))
    return np.array(found) / (2 * STEP)
