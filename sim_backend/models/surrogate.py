"""The fast model: one scene's force and stress over place, depth and pressure, solved beforehand.

What `sim_backend.models.trained_states` solves is kept: the logarithms of force and stress go
through tensor-product splines, cubic over all; between places a fine table of them is linear.
Validation states, outside the grid, measure the error. The table is kept on disk under the scene's
content, so the second use costs nothing. Outside the grid nothing is extrapolated: the full model
answers.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import ceil
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import NdBSpline, make_interp_spline

from sim_backend.arrays import Array
from sim_backend.models.force_model import ForceSlope, Range
from sim_backend.models.kept_tables import kept_table, table_file
from sim_backend.models.response import levels_pa
from sim_backend.models.second_process import all_answers
from sim_backend.models.trained_states import (
    SHALLOWEST_M,
    VALIDATION_NEAR,
    influences,
    solve_grid,
    states,
    validation,
)
from sim_backend.scene.scene_file import Scene, SceneError

ORDERS = (1, 1, 3, 3)
"""Of the splines at most, across and along the vessels, over depth and pressure: a quarter of what
cubic ones over places cost, and as near where places are as close as `PLACE_STEP_M`."""
PLACE_STEP_M = 0.5e-3
"""A bump 5 mm wide is off by step^2 / (8 width^2) between places: 0.1 % of its own height."""
FINER = 3
"""As many steps at least between two places that are solved: over a narrow bump they are close."""
SAFETY = 2.0
"""The stated error is this times the largest seen on validation states."""
TABLE = 8
"""Number of the way of training; a table trained in another way is not used."""
TRAINED = ("x", "z", "depth", "pressure", "solved", "errors")
"""The arrays of `train`."""


@dataclass(frozen=True)
class Surrogate:
    """A `sim_backend.models.force_model.ForceModel`. Outside its ``range`` force and stress come
    from the full model; slopes and errors are known inside only.

    ``force_error_pct`` and ``pulse_error_pct`` bound what validation states showed; a pulse is the
    change of force between the ends of the wave, against 1 % of the force where it is smaller (of a
    solid 2 %).
    """

    scene: Scene
    range: Range
    force_error_pct: float
    pulse_error_pct: float
    log_force: NdBSpline
    log_stress: NdBSpline

    def force_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike, z_m: ArrayLike = 0.0
    ) -> Array:
        """Normal force [N] on the whole finger; arguments broadcast. ``z_m``: along the
        vessels. Raises `CannotSolve`."""
        return self._at(self.log_force, 0, x_m, depth_m, pressure_pa, z_m)

    def von_mises_pa(
        self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike, z_m: ArrayLike = 0.0
    ) -> Array:
        """Von Mises stress [Pa] at the surface under the finger; as `force_n`."""
        return self._at(self.log_stress, 1, x_m, depth_m, pressure_pa, z_m)

    def slope(
        self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike, z_m: ArrayLike = 0.0
    ) -> ForceSlope:
        self.range.check(x_m, depth_m, pressure_pa, z_m)
        points = self._points(x_m, depth_m, pressure_pa, z_m)
        force = np.exp(self.log_force(points))
        by_log_depth = self.log_force(points, nu=(0, 0, 1, 0))
        by_depth = force * by_log_depth / np.exp(points[..., 2])
        return ForceSlope(by_depth, force * self.log_force(points, nu=(0, 0, 0, 1)))

    def error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike, z_m: ArrayLike = 0.0
    ) -> Array:
        self.range.check(x_m, depth_m, pressure_pa, z_m)
        return 0.01 * self.force_error_pct * self.force_n(x_m, depth_m, pressure_pa, z_m)

    def pulse_error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike,
        z_m: ArrayLike = 0.0,
    ) -> Array:  # fmt: skip
        self.range.check(x_m, depth_m, low_pa, z_m)
        self.range.check(x_m, depth_m, high_pa, z_m)
        low, high = (self.force_n(x_m, depth_m, p, z_m) for p in (low_pa, high_pa))
        small = validation(self.scene).small_pulse
        pulse = np.maximum(np.abs(high - low), small * np.maximum(low, high))
        return np.asarray(np.where(low == high, 0.0, 0.01 * self.pulse_error_pct * pulse))

    def _points(
        self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike, z_m: ArrayLike
    ) -> Array:
        """Coordinates (..., 4) of the splines, clamped to the range."""
        known, at = self.range, (x_m, z_m, depth_m, pressure_pa)
        ends = known.x_m, known.z_m, known.depth_m, known.pressure_pa
        points = np.empty((*np.broadcast_shapes(*map(np.shape, at)), len(at)))
        for axis, (asked, limits) in enumerate(zip(at, ends, strict=True)):
            points[..., axis] = np.clip(asked, *limits)
        points[..., 2] = np.log(points[..., 2])
        return points

    def _at(
        self, spline: NdBSpline, which: int, x_m: ArrayLike, depth_m: ArrayLike, p_pa: ArrayLike,
        z_m: ArrayLike,
    ) -> Array:  # fmt: skip
        result = np.asarray(np.exp(spline(self._points(x_m, depth_m, p_pa, z_m))))
        inside = self.range.holds(x_m, depth_m, p_pa, z_m)
        if not inside.all():
            x, z, d, p = np.broadcast_arrays(x_m, z_m, depth_m, p_pa)
            for i in np.argwhere(~np.broadcast_to(inside, result.shape)):
                at = tuple(i)
                one = float(x[at]), float(z[at]), float(d[at]), np.array([float(p[at])])
                # no force out of contact
                result[at] = states(self.scene, *one, finer=False)[0, which] if one[2] > 0 else 0.0
        return result


def surrogate(scene: Scene, max_depth_mm: float = 2.5) -> Surrogate:
    """The trained model, from the disk where it is known, else trained now: tens of seconds for a
    section, minutes for a solid.

    Raises `SceneError` for a depth that cannot be meant or a lone vessel, and `CannotSolve` where
    training meets a physical limit.
    """
    if scene.tissue is None:
        raise SceneError(
            f"{scene.name} is a lone vessel, which is pressed over its middle only: the fast model "
            "needs [tissue]; take --model finite"
        )
    if not 1e3 * SHALLOWEST_M < max_depth_mm < scene.surface_mm:
        raise SceneError(
            f"max_depth_mm = {max_depth_mm:g}: must lie between {1e3 * SHALLOWEST_M:g} and "
            f"the {scene.surface_mm:g} mm of {scene.name}"
        )
    return _known(scene, round(1e-3 * max_depth_mm, 9))


@lru_cache(maxsize=8)
def _known(scene: Scene, max_depth_m: float) -> Surrogate:
    path = cache_file(scene, max_depth_m)
    table = kept_table(path, TRAINED, lambda: train(scene, max_depth_m))
    return _from_table(scene, table)


def cache_file(scene: Scene, max_depth_m: float) -> Path:
    """Where the table of this scene lies; its name is the content's hash and our version."""
    content = scene.model_dump(mode="json", exclude={"name"})
    return table_file("fast", [content, max_depth_m, TABLE])


def train(scene: Scene, max_depth_m: float) -> dict[str, Array]:
    """Solve the grid and the validation states."""
    table = solve_grid(scene, max_depth_m)
    return table | {"errors": _validation_errors(scene, table)}


def _from_table(scene: Scene, table: dict[str, Array]) -> Surrogate:
    x, z, depth, pressure = (table[axis] for axis in ("x", "z", "depth", "pressure"))
    force_pct, pulse_pct = table.get("errors", np.full(2, np.nan)).tolist()
    known = Range(_ends(x), _ends(depth), _ends(pressure) if scene.arteries else (0.0, np.inf),
                  _ends(z))  # fmt: skip
    x, solved = _finer(x, np.log(table["solved"]), 0)
    z, solved = _finer(z, solved, 1)
    axes = x, z, np.log(depth), pressure
    force, stress = (_spline(axes, solved[..., k]) for k in (0, 1))
    return Surrogate(scene, known, force_pct, pulse_pct, force, stress)


def _finer(places_m: Array, values: Array, axis: int) -> tuple[Array, Array]:
    """Places at most `PLACE_STEP_M` apart, and what a cubic spline says there."""
    if len(places_m) == 1:
        return places_m, values
    steps = [max(FINER, ceil(way / PLACE_STEP_M - 1e-6)) for way in np.diff(places_m)]
    ends = zip(pairwise(places_m), steps, strict=True)
    fine = np.concatenate([np.linspace(a, b, n, endpoint=False) for (a, b), n in ends])
    fine = np.append(fine, places_m[-1])
    order = min(3, len(places_m) - 1)
    return fine, np.asarray(make_interp_spline(places_m, values, k=order, axis=axis)(fine))


def _ends(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[-1])


def _spline(axes: tuple[Array, ...], values: Array) -> NdBSpline:
    """Through ``values`` on the grid; of an axis with a single value any other has the same."""
    knots, orders = [], []
    for axis, (at, highest) in enumerate(zip(axes, ORDERS, strict=True)):
        order = min(highest, len(at) - 1)
        if order == 0:
            knots.append(np.array([at[0], at[0] + 1.0]))
        else:
            one = make_interp_spline(at, values, k=order, axis=axis)
            values = np.moveaxis(one.c, 0, axis) if one.c.shape[axis] != len(at) else one.c
            knots.append(one.t)
        orders.append(order)
    return NdBSpline(tuple(knots), values, tuple(orders))


def _validation_errors(scene: Scene, table: dict[str, Array]) -> Array:
    """Largest error of force and of pulse [%] over random states, times `SAFETY`."""
    model = _from_table(scene, table)
    known, kept = model.range, validation(scene)
    rng = np.random.default_rng(len(table["x"]))
    _, *ends = levels_pa(scene)
    beats = np.array(ends) if scene.arteries else np.zeros(1)
    ranges = known.x_m, known.z_m, known.depth_m
    places = _spread(rng, kept.states, *ranges)
    for bump in influences(scene, known.depth_m[1]):
        x_m = max(bump.low, known.x_m[0]), min(bump.high, known.x_m[1])
        z_m = max(bump.along[0], known.z_m[0]), min(bump.along[1], known.z_m[1])
        seen = sum(x_m[0] <= x <= x_m[1] and z_m[0] <= z <= z_m[1] for x, z, _ in places)
        lacking = round(VALIDATION_NEAR * kept.states) - seen
        if x_m[0] < x_m[1] and z_m[0] <= z_m[1] and lacking > 0:
            places += _spread(rng, lacking, x_m, z_m, known.depth_m)
    tasks = [(scene, *place, beats, True) for place in places]
    errors = []
    for (_, x, z, d, _, _), solved in zip(tasks, all_answers(states, tasks), strict=True):
        ours, truth = model.force_n(x, d, beats, z), solved[:, 0]
        pulse, span = float(np.ptp(ours)), float(np.ptp(truth))
        floor = kept.small_pulse * truth.max()
        errors.append((np.abs(ours / truth - 1).max(), abs(pulse - span) / max(span, floor)))
    return np.asarray(np.maximum(100 * SAFETY * np.max(errors, axis=0), kept.least_pct))


def _spread(
    rng: np.random.Generator, count: int, *ranges: tuple[float, float]
) -> list[tuple[float, float, float]]:
    """Random (x, z, depth) [m] within ``ranges``; each is drawn from evenly, as few states must see
    all of it, and the depth by its logarithm."""
    shares = np.array([rng.permutation(count) for _ in ranges])
    shares = (shares + rng.random(shares.shape)) / count
    ends = [*ranges[:2], tuple(np.log(ranges[2]))]
    x, z, log_depth = (
        low + share * (high - low) for share, (low, high) in zip(shares, ends, strict=True)
    )
    return list(zip(x.tolist(), z.tolist(), np.exp(log_depth).tolist(), strict=True))
