"""Make a `TouchTable`: presses at random places over random bodies, and least squares.

Each press is solved at a few depths, over a vessel at diastole and systole, with the exact
derivatives of its force by every number of its scene.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from sim_backend.arrays import Array
from sim_backend.fem.newton import CannotSolve
from sim_backend.fem.sensitivity import gradients
from sim_backend.models.solved import Solved
from sim_backend.models.stations import ramp
from sim_backend.scene.numbers import numbers
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG
from sim_backend.touch.bodies import Units
from sim_backend.touch.kinds import BARE, KINDS, VESSEL, Kind
from sim_backend.touch.table import Ratios, TouchTable, about_finger

SUNK = np.array([0.06, 0.15, 0.3, 0.5])
"""Depths that are solved, over the finger's half width."""
PRESSES = 3000
WEIGHT_OF_SLOPES = 0.3
"""Of a slope times its parameter's spread, beside a value; 0.1 and 1 fit lumps alike."""
RIDGE = 1e-7
"""Of the mean of the normal equations' diagonal, times one plus the square of a term's degree."""
HELD_OUT = 5
"""Every fifth press is not trained on, but says what the table is off by."""
ROUNDS, FAR = 4, 2.385
"""Of least squares, each with the weight 1 / (1 + (r / FAR)^2) that a state's residual r of the
round before leaves it, in standard deviations (Cauchy's weights; Holland & Welsch 1977, table 1):
far aside of a vessel, at its block's side, a bump is up to a hundred times `Kind.size`."""
SD_OF_MEDIAN = 1.4826  # of a normal distribution (Hampel 1974)
FREEDOM = 5.0
"""Degrees of freedom of Student's t, as which presses held out are off."""
STEP = 1e-5
SEED = 0
ASIDE = 1.7
"""Exponent by which places crowd about a body, where its bump is."""
REACH = 6.0
"""How far aside of a body is pressed at most; there its bump has fallen to 1 or 2 %."""
OFF_SIDE = 0.4
"""How near to a side of its block is pressed at most."""


class Samples(NamedTuple):
    """Solved states over a kind of body: where (n,), how deep (n,) and over what (n, p); force and
    pulse (n, 2), and their derivatives (n, p + 1, 2) by each parameter and by depth, NaN where
    unknown. ``press`` (n,) numbers a kind's presses, of each of which several depths are solved.

    Of a bare block the first value is the logarithm of its force over its depth.
    """

    x: Array
    sunk: Array
    theta: Array
    value: Array
    slope: Array
    press: Array

    def where(self, chosen: Array) -> "Samples":
        return Samples(*(column[chosen] for column in self))

    def over(self, bare: Ratios) -> "Samples":
        """Bump and pulse over the ``bare`` block's force."""

        def force(x: Array, sunk: Array, block: Array) -> Array:
            return np.asarray(sunk[:, None] * np.exp(bare(x, sunk, block)[:, :1]))

        block = self.theta[:, -2:]
        below = force(self.x, self.sunk, block)
        slope = np.zeros_like(self.slope)
        slope[:, -3:] = np.stack([*_slopes(force, self.x, self.sunk, block)], axis=1)
        value = self.value / below
        slope = (self.slope - value[:, None] * slope) / below[:, None]
        return self._replace(value=value - [1.0, 0.0], slope=slope)


def touch_table(
    block: Scene,
    presses: int = PRESSES,
    mapping: Callable[..., Iterable[tuple[Samples, Samples]]] = map,
    counting: Callable[[int, int], None] = lambda _done, _total: None,
) -> TouchTable:
    """The table of plane blocks of any size on the support of ``block``, under its finger; what
    lies in it does not matter.

    ``presses`` are solved over bodies of each kind. ``mapping`` is `map` or that of a pool of
    processes; ``counting`` hears how many presses are done, of how many.
    """
    ratios: dict[str, Ratios] = {}
    solved: dict[str, list[tuple[Samples, Samples]]] = {kind.name: [] for kind in KINDS}
    for n, name in enumerate(solved):
        for pair in mapping(partial(random_press, name, block), range(presses)):
            solved[name].append(pair)
            counting(n * presses + len(solved[name]), len(KINDS) * presses)
    bare = trained(BARE, joined([of_block for pairs in solved.values() for _, of_block in pairs]))
    for kind in KINDS:
        bodies = joined([of_body for of_body, _ in solved[kind.name]])
        ratios[kind.name] = trained(kind, bodies.over(bare))
    return TouchTable(about_finger(block), {BARE.name: bare, **ratios})


def random_press(name: str, block: Scene, number: int) -> tuple[Samples, Samples]:
    """The ``number``-th press over a random body, and over the same block with nothing in it; what
    cannot be solved is drawn again."""
    kind = next(kind for kind in KINDS if kind.name == name)
    rng, units = np.random.default_rng([SEED, len(name), number]), Units(block)
    low, high = np.array(kind.low), np.array(kind.high)
    while True:
        theta = low + (high - low) * rng.random(len(low))
        if kind is VESSEL and rng.random() < 0.5:
            theta[kind.parameters.index("narrowing")] = 0.0
        x = theta[0] + REACH * np.sign(rng.random() - 0.5) * rng.random() ** ASIDE
        if not kind.fits(theta[None])[0] or abs(x) > np.exp(theta[-1]) - OFF_SIDE:
            continue
        with suppress(CannotSolve, ValueError):  # no room, or beyond what can be solved
            return sample(kind, units, theta, x, number)


def joined(parts: Sequence[Samples]) -> Samples:
    """All of them."""
    return Samples(*map(np.concatenate, zip(*parts, strict=True)))


def sample(
    kind: Kind, units: Units, theta: Array, x: float, number: int
) -> tuple[Samples, Samples]:
    """One press at all depths, over the body and over the bare block."""
    block, count = theta[-2:], len(SUNK)
    of_body, by_body = _pressed(kind, units, theta, x)
    if kind is VESSEL and theta[kind.parameters.index("narrowing")] == 0:
        by_body[:, kind.parameters.index("narrowing")] = (
            np.nan
        )  # a ring of no thickness has no mesh
    of_bare, by_bare = _pressed(BARE, units, block, x)
    force = of_bare[:, :1]
    log_force, by_log = of_bare * 0, by_bare / force[:, None]
    log_force[:, :1] = np.log(force / SUNK[:, None])
    by_log[:, -1, 0] -= 1 / SUNK
    where, press = np.full(count, x), np.full(count, number)
    return (
        Samples(where, SUNK, np.tile(theta, (count, 1)), of_body, by_body, press),
        Samples(where, SUNK, np.tile(block, (count, 1)), log_force, by_log, press),
    )


def _pressed(kind: Kind, units: Units, theta: Array, x: float) -> tuple[Array, Array]:
    """Force at diastole and pulse (d, 2) at each depth, and their derivatives (d, p + 1, 2) by each
    parameter and by depth."""
    scene, unit, count = units.scene((kind, theta)), units.force_n_per_m, 1 + kind.beats
    by_parameters = [_by_parameters(kind, units, theta, end) for end in range(count)]
    force, slope = np.zeros((len(SUNK), count)), np.zeros((len(SUNK), len(theta) + 1, count))
    for k, solved in enumerate(at_depths(scene, 1e-3 * units.place_mm(x, theta))):
        for end, state in enumerate(solved.states[:count]):
            force[k, end] = state.force / unit
            by = gradients(solved.body, state, scene, list(by_parameters[end]))
            slope[k, :, end] = sum(by[key] * along for key, along in by_parameters[end].items())
    # a width moves all nodes along the finger, and its slope is mostly that of the mesh's own error
    slope[:, kind.parameters.index("log_half_width")] = np.nan
    pulse = np.array([[1.0, -1.0], [0.0, 1.0]] if kind.beats else [[1.0, 0.0]])
    return force @ pulse, slope @ pulse / unit


def _by_parameters(kind: Kind, units: Units, theta: Array, end: int) -> dict[str, Array]:
    """Derivatives (p + 1,) of each of the press's numbers by the kind's parameters and by depth, at
    that end of the beat."""
    rows = []
    for k in range(len(theta) + 1):
        step = STEP * np.eye(len(theta) + 1)[k]
        if k < len(theta) and kind.parameters[k] == "narrowing" and theta[k] == 0:
            step *= 0
        ahead, behind = (
            _numbers(kind, units, theta + s * step[:-1], s * step[-1], end) for s in (1, -1)
        )
        rows.append([(ahead[key] - behind[key]) / (2 * STEP) for key in ahead])
    return dict(zip(ahead, np.transpose(rows), strict=True))


def _numbers(kind: Kind, units: Units, theta: Array, sunk: float, end: int) -> dict[str, float]:
    """The press's numbers that depend on ``theta`` and on how deep it is; over a vessel the
    pressure at the beat's ``end``, too: 0 diastole, 1 systole."""
    scene = units.scene((kind, theta))
    beat = scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg
    loads = {"depth_mm": sunk * units.length_mm}
    loads |= {"pressure_mmhg": beat[end]} if kind.beats else {}
    return loads | {
        key: value for key, value in numbers(scene).items()
        if key == "tissue.height_mm"
        or (key.startswith("inclusion.0") and not key.endswith("poisson"))
    }  # fmt: skip


def at_depths(scene: Scene, x_m: float) -> list[Solved]:
    """At each depth the state at diastole and at systole."""
    depths_m = SUNK * 0.5e-3 * scene.indenter.width_mm_projected
    beat = scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg
    return ramp(scene, x_m, depths_m.tolist(), [PA_PER_MMHG * p for p in beat])


def trained(kind: Kind, samples: Samples) -> Ratios:
    """Robust least squares on values and derivatives; the error is that of presses held out."""
    held_out = samples.press % HELD_OUT == 0
    test = samples.where(held_out)
    ratios = _fit(kind, samples.where(~held_out))
    off = ratios(test.x, test.sunk, test.theta) - test.value
    there, over = kind.size(test.x, test.theta), kind.central(test.theta)
    error = np.zeros((2, 2))
    for output in range(1 + kind.beats):
        error[:, output] = _most_likely_error(off[:, output], there[:, output], over[:, output])
    return replace(_fit(kind, samples), error=error)


def _most_likely_error(off: Array, there: Array, over: Array) -> Array:
    """Parts (2,) of sizes ``there`` (n,) and ``over`` a body (n,), of which squares sum up to the
    variance of what is ``off`` (n,), which is distributed as Student's t."""

    def unlikely(log_parts: Array) -> float:
        scale2 = (there * np.exp(log_parts[0])) ** 2 + (over * np.exp(log_parts[1])) ** 2
        return float((np.log(scale2) + (FREEDOM + 1) * np.log1p(off**2 / scale2 / FREEDOM)).sum())

    first = np.log(np.sqrt((off**2).mean() / (over**2).mean())) * np.ones(2)
    scales = np.exp(minimize(unlikely, first, method="Nelder-Mead").x)
    return np.asarray(scales * np.sqrt(FREEDOM / (FREEDOM - 2)))


def _fit(kind: Kind, samples: Samples) -> Ratios:
    """By least squares; again and again, what is far off having less weight."""
    x, sunk, theta, value, *_ = samples
    size, trust = kind.size(x, theta)[:, : 1 + kind.beats], np.ones(len(x))
    for _ in range(ROUNDS):
        ratios = _least_squares(kind, samples, trust)
        off = (ratios(x, sunk, theta) - value)[:, : 1 + kind.beats] * np.sqrt(sunk[:, None] / size)
        scatter = SD_OF_MEDIAN * np.median(np.abs(off), axis=0)
        trust = 1 / (1 + ((off / (FAR * scatter)) ** 2).max(axis=1))
    return ratios


def _least_squares(kind: Kind, samples: Samples, trust: Array) -> Ratios:
    """With a weight (n,) for each state."""
    x, sunk, theta, value, slope, _ = samples
    coordinates = kind.at(x, sunk, theta)
    low, high = coordinates.min(axis=0), coordinates.max(axis=0)
    high[: kind.mirrored] = np.abs(coordinates[:, : kind.mirrored]).max(axis=0)
    low[: kind.mirrored] = -high[: kind.mirrored]
    ratios = Ratios(kind, low, high, np.zeros((0, 2)), np.zeros((2, 2)))
    terms = _at_terms(ratios)(x, sunk, theta)
    size, spread = kind.size(x, theta), np.append(theta.std(axis=0), sunk.std())
    outputs, count = range(1 + kind.beats), terms.shape[1]
    ratio = value / np.where(size, size, 1.0)
    weight = np.sqrt(size * (sunk * trust)[:, None])  # small bumps need not be known as well
    normal, right = np.zeros((len(outputs), count, count)), np.zeros((len(outputs), count))

    def learn(output: int, rows: Array, of: Array) -> None:
        normal[output] += rows.T @ rows
        right[output] += rows.T @ of

    for output in outputs:
        learn(output, terms * weight[:, output, None], (ratio * weight)[:, output])
    turned_sizes = _slopes(lambda x, _, theta: kind.size(x, theta), x, sunk, theta)
    for k, (turned, turned_size) in enumerate(
        zip(_slopes(_at_terms(ratios), x, sunk, theta), turned_sizes, strict=True)
    ):
        for output in outputs:  # the quotient's rule
            along = (slope[:, k] - ratio * turned_size)[:, output] / size[:, output]
            known = np.isfinite(along)
            scale = WEIGHT_OF_SLOPES * spread[k] * weight[known, output]
            learn(output, turned[known] * scale[:, None], along[known] * scale)
    coefficients = np.zeros((count, 2))
    degrees = ratios.basis.exponents.sum(axis=1)
    for output in outputs:
        ridge = RIDGE * np.trace(normal[output]) / count
        whole = normal[output] + ridge * np.diag(1.0 + degrees**2)
        coefficients[:, output] = np.linalg.solve(whole, right[output])
    return replace(ratios, coefficients=coefficients)


def _at_terms(ratios: Ratios) -> Callable[[Array, Array, Array], Array]:
    """The polynomials' terms (n, terms) at places, depths and parameters."""
    return lambda x, sunk, theta: ratios.basis.values(ratios.scaled(ratios.kind.at(x, sunk, theta)))


def _slopes(
    function: Callable[[Array, Array, Array], Array], x: Array, sunk: Array, theta: Array
) -> Iterator[Array]:
    """Derivatives (n, outputs) by each parameter and by depth, by central differences."""
    for k in range(theta.shape[1]):
        step = STEP * np.eye(theta.shape[1])[k]
        yield (function(x, sunk, theta + step) - function(x, sunk, theta - step)) / (2 * STEP)
    yield (function(x, sunk + STEP, theta) - function(x, sunk - STEP, theta)) / (2 * STEP)
