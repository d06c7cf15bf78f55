"""The fast model: one scene's force and stress over place, depth and pressure, solved beforehand.

Finite strain is solved on a grid of places, depths and lumen pressures; the logarithms of force
and stress go through tensor-product cubic splines. States that were held back measure the error.
The table is kept on disk under the scene's content, so the second use costs nothing. Outside the
grid nothing is extrapolated: the full model answers.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import NdBSpline, make_interp_spline

from sim_backend.arrays import Array
from sim_backend.fem.continuation import continuation, unloaded
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import build_section
from sim_backend.fem.newton import Load
from sim_backend.fem.stress import under_finger_pa
from sim_backend.models.force_model import ForceSlope, Range
from sim_backend.models.kept_tables import kept_table, table_file
from sim_backend.models.second_process import all_answers
from sim_backend.models.station_response import element_size_m
from sim_backend.scene.scene_file import Scene, SceneError, mirrored
from sim_backend.scene.waves import PA_PER_MMHG

SHALLOWEST_M = 0.4e-3
DEPTH_NODES = 7
FAR_STEP_M, NEAR_STEP_M, NEAR_M = 2e-3, 1.75e-3, 10e-3
PRESSURES = (0.5, 1.1)
"""Shares of the lowest and highest pressure of the wave: an empty vessel is not what beats."""
PRESSURE_NODES = 3
SMALL_PULSE = 1e-2
COARSER = 1.4
"""Element size over the usual one: 0.15 % of the force for a fifth of the time."""
HELD_BACK = 10
SAFETY = 2.0
"""The stated error is this times the largest seen on states held back."""
FLOOR_PCT = (0.2, 2.0)
"""And never less than this of force and pulse, which is what the mesh misses."""
TABLE = 5
"""Number of the way of training; a table trained in another way is not used."""


@dataclass(frozen=True)
class Surrogate:
    """A `sim_backend.models.force_model.ForceModel`. Outside its ``range`` force and stress come
    from the full model; slopes and errors are known inside only.

    ``force_error_pct`` and ``pulse_error_pct`` bound what held-back states showed; a pulse is the
    change of force between the ends of the wave, against 1 % of the force where it is smaller.
    """

    scene: Scene
    range: Range
    force_error_pct: float
    pulse_error_pct: float
    log_force: NdBSpline
    log_stress: NdBSpline

    def force_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Normal force [N] on the whole finger; arguments broadcast. Raises `CannotSolve`."""
        return self._at(self.log_force, 0, x_m, depth_m, pressure_pa)

    def von_mises_pa(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Von Mises stress [Pa] at the surface under the finger; as `force_n`."""
        return self._at(self.log_stress, 1, x_m, depth_m, pressure_pa)

    def slope(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> ForceSlope:
        self.range.check(x_m, depth_m, pressure_pa)
        points = self._points(x_m, depth_m, pressure_pa)
        force = np.exp(self.log_force(points))
        by_log_depth = self.log_force(points, nu=(0, 1, 0))
        by_depth = force * by_log_depth / np.exp(points[..., 1])
        return ForceSlope(by_depth, force * self.log_force(points, nu=(0, 0, 1)))

    def error_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        self.range.check(x_m, depth_m, pressure_pa)
        return 0.01 * self.force_error_pct * self.force_n(x_m, depth_m, pressure_pa)

    def pulse_error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike
    ) -> Array:
        self.range.check(x_m, depth_m, low_pa)
        low, high = (self.force_n(x_m, depth_m, p) for p in (low_pa, high_pa))
        self.range.check(x_m, depth_m, high_pa)
        pulse = np.maximum(np.abs(high - low), SMALL_PULSE * np.maximum(low, high))
        return np.asarray(np.where(low == high, 0.0, 0.01 * self.pulse_error_pct * pulse))

    def _points(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Coordinates (..., 3) of the splines, held to the range."""
        points = np.stack(np.broadcast_arrays(x_m, depth_m, pressure_pa), axis=-1).astype(float)
        lows, highs = np.array([self.range.x_m, self.range.depth_m, self.range.pressure_pa]).T
        points = np.clip(points, lows, highs)
        points[..., 1] = np.log(points[..., 1])
        return np.asarray(points)

    def _at(
        self, spline: NdBSpline, which: int, x_m: ArrayLike, depth_m: ArrayLike, p_pa: ArrayLike
    ) -> Array:
        x, d, p = np.broadcast_arrays(x_m, depth_m, p_pa)
        result = np.asarray(np.exp(spline(self._points(x_m, depth_m, p_pa))))
        inside = self.range.holds(x, d, p)
        for i in np.argwhere(~inside):
            at = tuple(i)
            result[at] = self._full(float(x[at]), float(d[at]), float(p[at]))[which]
        return result

    def _full(self, x_m: float, depth_m: float, pressure_pa: float) -> tuple[float, float]:
        """Force [N] and stress [Pa] by the full model, 0 out of contact."""
        if depth_m <= 0:
            return 0.0, 0.0
        ((force, stress),) = _column(
            self.scene, x_m, np.array([depth_m]), np.array([pressure_pa])
        ).reshape(1, 2)
        return float(force), float(stress)


def surrogate(scene: Scene, max_depth_mm: float = 2.5) -> Surrogate:
    """The trained model, from the disk where it is known, else trained now (tens of seconds).

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
    table = kept_table(cache_file(scene, max_depth_m), lambda: train(scene, max_depth_m))
    return _from_table(scene, table)


def cache_file(scene: Scene, max_depth_m: float) -> Path:
    """Where the table of this scene lies; its name is the content's hash and our version."""
    content = scene.model_dump(mode="json", exclude={"name"})
    return table_file("fast", [content, max_depth_m, TABLE])


def train(scene: Scene, max_depth_m: float) -> dict[str, Array]:
    """Solve the grid and the states held back."""
    x = _places(scene)
    depth = np.geomspace(SHALLOWEST_M, max_depth_m, DEPTH_NODES)
    pressure = _pressures(scene)
    columns = [(scene, float(xi), depth, pressure, COARSER) for xi in x]
    solved = np.stack(all_answers(_column, columns))
    table = {"x": x, "depth": depth, "pressure": pressure, "solved": solved}
    return table | {"errors": _held_back(scene, table)}


def _places(scene: Scene) -> Array:
    """Places to solve [m]: close to each other near inclusions; half of them by symmetry."""
    assert scene.tissue is not None  # `surrogate` has looked
    width = 1e-3 * scene.tissue.width_mm
    low = min(4e-3, width / 8)
    high = width / 2 if mirrored(scene) == scene else width - low
    x = [low]
    while x[-1] < high - 1e-9:
        beyond_m = [abs(1e-3 * one.x_mm - x[-1]) - NEAR_M for one in scene.inclusion]
        near = bool(beyond_m) and min(beyond_m) < 0
        x.append(min(x[-1] + (NEAR_STEP_M if near else FAR_STEP_M), high))
    return np.array(x)


def _pressures(scene: Scene) -> Array:
    if not scene.arteries:
        return np.zeros(1)
    low, high = PRESSURES
    ends = low * scene.pulse.diastolic_mmhg, high * scene.pulse.systolic_mmhg
    return PA_PER_MMHG * np.linspace(*ends, PRESSURE_NODES)


def _column(scene: Scene, x_m: float, depth: Array, pressure: Array, coarser: float = 1.0) -> Array:
    """Force [N] and stress [Pa] (depths, pressures, 2) at one place.

    All pressures at each depth, there and back: a change of pressure takes fewer Newton steps than
    a change of depth.
    """
    size_m = coarser * element_size_m(scene)
    section = build_section(scene, x_m, depth_m=float(depth[-1]), size_m=size_m)
    down = range(len(pressure))[::-1]
    path = [(i, j) for i in range(len(depth)) for j in (down if i % 2 == 0 else down[::-1])]
    loads = [Load(float(depth[i]), float(pressure[j])) for i, j in path]
    start = unloaded(section)
    if loads[0].pressure_pa > 0:
        (start,) = continuation(section, start, [Load(-float(depth[-1]), loads[0].pressure_pa)])
    result = np.empty((len(depth), len(pressure), 2))
    length_m = 1e-3 * scene.indenter.length_mm
    for at, solution in zip(path, continuation(section, start, loads), strict=True):
        stress = under_finger_pa(section, solution.displacement)
        result[at] = length_m * solution.force_n_per_m, stress
    return result


def _from_table(scene: Scene, table: dict[str, Array]) -> Surrogate:
    x, pressure, solved = table["x"], table["pressure"], np.log(table["solved"])
    if scene.tissue is not None and mirrored(scene) == scene:
        width = 1e-3 * scene.tissue.width_mm
        x = np.concatenate([x, (width - x)[-2::-1]])
        solved = np.concatenate([solved, solved[-2::-1]])
    range_pa = (float(pressure[0]), float(pressure[-1]))
    if len(pressure) == 1:  # no vessel: any pressure, one answer
        pressure, range_pa = np.array([0.0, 1.0]), (0.0, np.inf)
        solved = np.repeat(solved, 2, axis=2)
    log_depth = np.log(table["depth"])
    depths = float(table["depth"][0]), float(table["depth"][-1])
    force_pct, pulse_pct = table.get("errors", np.full(2, np.nan)).tolist()
    return Surrogate(
        scene, Range((float(x[0]), float(x[-1])), depths, range_pa), force_pct, pulse_pct,
        *(_spline((x, log_depth, pressure), solved[..., k]) for k in (0, 1)),
    )  # fmt: skip


def _spline(axes: tuple[Array, Array, Array], values: Array) -> NdBSpline:
    knots, orders = [], []
    for axis, at in enumerate(axes):
        order = min(3, len(at) - 1)
        one = make_interp_spline(at, values, k=order, axis=axis)
        values = np.moveaxis(one.c, 0, axis) if one.c.shape[axis] != len(at) else one.c
        knots.append(one.t)
        orders.append(order)
    return NdBSpline(tuple(knots), values, tuple(orders))


def _held_back(scene: Scene, table: dict[str, Array]) -> Array:
    """Largest error of force and of pulse [%] over random states, times `SAFETY`."""
    model = _from_table(scene, table)
    rng = np.random.default_rng(len(table["x"]))
    ends = np.array([scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg]) * PA_PER_MMHG
    beats = ends if scene.arteries else np.zeros(1)
    states = []
    for _ in range(HELD_BACK):
        x = float(rng.uniform(*model.range.x_m))
        states.append((scene, x, float(np.exp(rng.uniform(*np.log(model.range.depth_m)))), beats))
    errors = []
    for (_, x, d, _), truth in zip(states, all_answers(_truth, states), strict=True):
        ours = model.force_n(x, d, beats)
        pulse, span = float(np.ptp(ours)), float(np.ptp(truth))
        floor = SMALL_PULSE * truth.max()
        errors.append((np.abs(ours / truth - 1).max(), abs(pulse - span) / max(span, floor)))
    return np.asarray(np.maximum(100 * SAFETY * np.max(errors, axis=0), FLOOR_PCT))


def _truth(scene: Scene, x_m: float, depth_m: float, pressure: Array) -> Array:
    """Force [N] at pressures (p,), solved at two thirds of the element size."""
    size_m = element_size_m(scene) / 1.5
    _, solutions = solve_finite(scene, x_m, depth_m, pressure.tolist(), size_m)
    return 1e-3 * scene.indenter.length_mm * np.array([s.force_n_per_m for s in solutions])
