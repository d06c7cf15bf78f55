"""A whole scan in about a second: every station at finite strain, each at the least cost.

- The mesh is fine under the finger and round vessels only; the rest of a block needs little.
- Newton starts from the block's own answer, which scans share (its displacements do not depend on
  its modulus), moved under the finger, plus the vessel's answer to its pressure alone. Where that
  start fails, the finger is lowered step by step as in `sim_backend.fem.finite_strain`.
- The pulse is the exact slope by pressure at the mean of diastole and systole, times their
  difference: right to second order. How forces bend between the two is solved over the vessel, and
  where they bend much, as near the pressure at which a wall bursts, by how much more a pulse is.

The station nearest to the vessel is solved again on elements of half the size. What that changes
corrects all stations, and with what a correction was seen to leave (benchmarks/figures/fleet.py)
bounds their error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array, Ints
from sim_backend.fem.continuation import continuation
from sim_backend.fem.field import Field
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import Grading, build_section
from sim_backend.fem.newton import (
    CannotSolve,
    Load,
    NotConverged,
    Solution,
    equilibrium,
    unloaded,
)
from sim_backend.fem.section import Section
from sim_backend.fem.sensitivity import slopes
from sim_backend.models.force_model import SLACK, ForceSlope, OutOfRange, Range
from sim_backend.models.plane_response import element_size_m
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.waves import PA_PER_MMHG

Displacements = Callable[[Array], Array]

CONTACT_SHARE, WALL_SHARE, GROWTH, COARSEST_M = 0.08, 0.35, 0.6, 6e-3
"""Element size: in the contact over the finger's half width, at inclusions over their radius, how
fast it grows from there, and its end."""
CANONICAL_KPA = 50.0
"""Modulus at which the bare block is solved; any would do."""
TOUCHING_SHARE = 0.02
"""First guess of the contact: nodes this near to the finger, over its half width. As much times the
tissue's modulus is the guess of their force."""
FINER = 0.5
"""Element size of what is solved again, over the first."""
MUCH = 0.1
"""Bend from which the pulse is solved too, over the vessel. Of 50 random presses over soft walls
(benchmarks/soft_walls.py at c51866cd) those that bend less are up to 0.7 times the stated error off
without it, the others up to 5.4 times, and with it up to 1.0 times."""
FORCE_LEFT, PULSE_LEFT = 0.003, 0.03
"""What a correction leaves at most: of the force, and of the scan's largest pulse."""


@dataclass(frozen=True)
class ScanEstimate:
    """A `sim_backend.models.force_model.ForceModel` of stations ``x_m`` (n,) at one ``depth_m``.

    Per station, force [N] on the whole finger: ``diastolic_n``, ``pulse_n`` from there to systole,
    ``half_pulse_n`` to the mean of both pressures; ``errors_n`` (2, n) bounds what diastolic force
    and pulse are off by. ``stiffness_n_m`` is the slope by depth at the mean pressure. All are NaN
    where there are ``reasons``. ``pressure_pa`` are diastole and systole.
    """

    x_m: Array
    depth_m: float
    pressure_pa: tuple[float, float]
    diastolic_n: Array
    pulse_n: Array
    half_pulse_n: Array
    errors_n: Array
    stiffness_n_m: Array
    reasons: tuple[CannotSolve | None, ...]

    @property
    def range(self) -> Range:
        """The stations (nothing is known between them), the one depth, and the beat; without a
        vessel any pressure."""
        ends = self.pressure_pa if self.beats else (-np.inf, np.inf)
        return Range((self.x_m.min(), self.x_m.max()), (self.depth_m, self.depth_m), ends)

    @property
    def beats(self) -> bool:
        return self.pressure_pa[1] > self.pressure_pa[0]

    def force_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Normal force [N] on the whole finger: a parabola through the three pressures."""
        at, share = self._at(x_m, depth_m, pressure_pa)
        half, whole = self.half_pulse_n[at], self.pulse_n[at]
        return self.diastolic_n[at] + share * ((4 * half - whole) + share * (2 * whole - 4 * half))

    def slope(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> ForceSlope:
        at, share = self._at(x_m, depth_m, pressure_pa)
        half, whole = self.half_pulse_n[at], self.pulse_n[at]
        by_share = (4 * half - whole) + 2 * share * (2 * whole - 4 * half)
        span_pa = self.pressure_pa[1] - self.pressure_pa[0]
        by_pressure = by_share / span_pa if self.beats else np.zeros_like(by_share)
        return ForceSlope(self.stiffness_n_m[at], by_pressure)

    def error_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        at, share = self._at(x_m, depth_m, pressure_pa)
        return np.asarray(self.errors_n[0][at] + share * self.errors_n[1][at])

    def pulse_error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike
    ) -> Array:
        at, low = self._at(x_m, depth_m, low_pa)
        _, high = self._at(x_m, depth_m, high_pa)
        return np.asarray(np.abs(high - low) * self.errors_n[1][at])

    def _at(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> tuple[Ints, Array]:
        """Numbers of the stations, and how far from diastole to systole."""
        self.range.check(x_m, depth_m, pressure_pa)
        x, _, pressure = np.broadcast_arrays(x_m, depth_m, pressure_pa)
        away_m = np.abs(x[..., None] - self.x_m)
        at = away_m.argmin(axis=-1)
        if (away_m.min(axis=-1) > SLACK).any():
            raise OutOfRange("no station was solved there: the places are this model's x_m")
        for reason in (self.reasons[k] for k in np.unique(at)):
            if reason is not None:
                raise reason
        low, high = self.pressure_pa
        share = (pressure - low) / (high - low) if self.beats else np.zeros(x.shape)
        return at, np.asarray(share)


def estimate_scan(scene: Scene, x_m: Sequence[float], depth_m: float) -> ScanEstimate:
    """Press ``depth_m`` deep at each of ``x_m`` [m], with the lumens from diastole to systole.

    Raises `SceneError` for a lone vessel, and `CannotSolve` where filling the vessel or pressing
    the station nearest to it meets a physical limit; elsewhere that is the station's reason.
    """
    if scene.tissue is None:
        raise SceneError(f"{scene.name}: a quick scan needs a block of tissue")
    if scene.indenter.bonded:
        raise SceneError(f"{scene.name}: a quick scan needs a finger that is not bonded")
    x = np.asarray(x_m, dtype=float)
    ends = (scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg) if scene.arteries else (0, 0)
    low, high = (PA_PER_MMHG * p for p in ends)
    load, half = Load(depth_m, (low + high) / 2), (high - low) / 2
    nearest = _nearest(scene, x)
    section = _section(scene, float(x[nearest]), depth_m)
    filled = _filled(section, load)
    over = _press(section, load, _guess(scene, section, load, filled))
    ratio = _again(scene, over, load)
    bend, more = _bends(over, load, (low, high))
    values = np.full((3, len(x)), np.nan)
    reasons: list[CannotSolve | None] = [None] * len(x)
    for k, place in enumerate(x):
        here = section if k == nearest else _section(scene, float(place), depth_m)
        try:
            at = over if k == nearest else _press(here, load, _guess(scene, here, load, filled))
            values[:, k] = at.solution.force_n_per_m, half * at.by_pressure, at.by_depth
        except CannotSolve as limit:
            reasons[k] = limit
    ratios = ratio[[0, 1, 0], None]
    force, swing, stiffness = 1e-3 * scene.indenter.length_mm * ratios * values
    off = np.abs(ratio - 1)
    share = off[1] + abs(more - 1)
    pulse_error = 2 * (PULSE_LEFT * np.nanmax(np.abs(swing)) + share * np.abs(swing))
    force_error = (FORCE_LEFT + off[0]) * force + pulse_error / 2 + abs(bend) * np.abs(swing)
    return ScanEstimate(
        x, depth_m, (low, high), force - (1 - bend) * swing, 2 * more * swing, (1 - bend) * swing,
        np.array([force_error, pulse_error]), stiffness, tuple(reasons),
    )  # fmt: skip


@dataclass(frozen=True)
class _Pressed:
    """With the slopes of the force by depth [N/m/m] and by pressure [N/m/Pa]."""

    section: Section
    solution: Solution
    by_depth: float = 0.0
    by_pressure: float = 0.0

    @property
    def field(self) -> Field:
        return Field(self.section.mesh.nodes, self.solution.displacement)


def _press(section: Section, load: Load, guess: Array) -> _Pressed:
    """Solve from displacements ``guess`` (n, 2); where that fails, or presses the walls of a vessel
    through each other, step by step from nothing."""
    surface = section.mesh.surface
    lowered = section.finger.lowered_to(section.finger.y - load.depth_m)
    gap, _, _ = lowered.gap((section.mesh.nodes + guess)[surface])
    near_m = TOUCHING_SHARE * (section.finger.profile.half_width)
    multiplier = np.where(gap < near_m, near_m * section.tissue_pa, 0.0)
    start = Solution(load, guess, (multiplier, np.zeros(len(section.mesh.resting))), 0.0, 0)
    try:
        solution = equilibrium(section, start, load)
        straight = not section.walls_cross(solution.displacement)
    except NotConverged:
        straight = False
    if not straight:
        steps = [Load(load.depth_m / 2, load.pressure_pa / 2), load]
        *_, solution = continuation(section, unloaded(section), steps)
    by_depth, by_pressure = slopes(section, solution)
    return _Pressed(section, solution, by_depth.force, by_pressure.force)


def _guess(scene: Scene, section: Section, load: Load, filled: Displacements) -> Array:
    """The bare block's displacements, moved under the finger, and the filled vessel's."""
    assert scene.tissue is not None
    width = 1e-3 * scene.tissue.width_mm
    tissue = scene.tissue.model_copy(update={"modulus_kpa": CANONICAL_KPA})
    bare = _bare(Scene(name="bare", plane=scene.plane, tissue=tissue, indenter=scene.indenter),
                 load.depth_m)  # fmt: skip
    nodes, bottom = section.mesh.nodes, section.sliding.dofs[0] // 2

    def moved(points: Array, slid: float) -> Array:
        across = np.clip(points[:, 0] + slid + width / 2 - section.finger.x, 1e-9, width - 1e-9)
        found = np.asarray(bare(np.column_stack([across, points[:, 1]])))
        found[:, 0] += slid
        return found

    slid = 0.0  # the bare block was fixed under its finger, this one is fixed in its middle
    for _ in range(3):
        slid -= float(section.sliding.weight @ moved(nodes[bottom], slid)[:, 0])
    return moved(nodes, slid) + np.asarray(filled(nodes))


@lru_cache(maxsize=8)
def _bare(scene: Scene, depth_m: float) -> Displacements:
    """Displacements of a block without inclusions, pressed in its middle."""
    assert scene.tissue is not None
    middle_m = 0.5e-3 * scene.tissue.width_mm
    section, (solution,) = solve_finite(scene, middle_m, depth_m, [0.0], element_size_m(scene))
    return _Pressed(section, solution).field


def _filled(section: Section, load: Load) -> Displacements:
    """Displacements by the lumens' pressure alone."""
    if not section.lumens:
        return lambda points: np.zeros_like(points)
    (solution,) = continuation(section, unloaded(section), [Load(-load.depth_m, load.pressure_pa)])
    return _Pressed(section, solution).field


def _again(scene: Scene, over: _Pressed, load: Load) -> Array:
    """Force and slope on smaller elements over those found (2,)."""
    section = _section(scene, over.section.finger.x, load.depth_m, FINER)
    fine = _press(section, load, np.asarray(over.field(section.mesh.nodes)))
    force = fine.solution.force_n_per_m / over.solution.force_n_per_m
    return np.array([force, fine.by_pressure / over.by_pressure if over.by_pressure else 1.0])


def _bends(over: _Pressed, load: Load, ends_pa: tuple[float, float]) -> tuple[float, float]:
    """How far the force at the lower pressure lies above the tangent at the mean one, over the
    tangent's fall to there; and the pulse over the tangent's."""
    if not over.by_pressure:
        return 0.0, 1.0

    def rise(pressure_pa: float) -> float:
        (end,) = continuation(over.section, over.solution, [Load(load.depth_m, pressure_pa)])
        straight = over.by_pressure * (pressure_pa - load.pressure_pa)
        return (end.force_n_per_m - over.solution.force_n_per_m) / straight

    fall = rise(ends_pa[0])
    return 1 - fall, (fall + rise(ends_pa[1])) / 2 if abs(1 - fall) > MUCH else 1.0


def _nearest(scene: Scene, x_m: Array) -> int:
    """The station nearest to any inclusion, or the middle one."""
    if not scene.inclusion:
        return len(x_m) // 2
    centres = 1e-3 * np.array([one.x_mm for one in scene.inclusion])
    return int(np.abs(x_m[:, None] - centres).min(axis=1).argmin())


def _section(scene: Scene, x_m: float, depth_m: float, share: float = 1.0) -> Section:
    """Fine under the finger and round inclusions, by ``share`` of this file's element sizes."""
    contact_m = share * CONTACT_SHARE * scene.indenter.profile.scale
    grading = Grading(
        contact_m, lambda radius_m: share * WALL_SHARE * radius_m, GROWTH, share * COARSEST_M
    )
    return build_section(scene, x_m, depth_m=depth_m, size_m=contact_m, grading=grading)
