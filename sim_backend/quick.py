"""A whole scan in about a second: every station at finite strain, each at the least cost.

- The mesh is fine under the finger and round vessels only; the rest of a block needs little.
- Newton starts from the block's own answer, which scans share (its displacements do not depend on
  its modulus), moved under the finger, plus the vessel's answer to its pressure alone. Where that
  start fails, the finger is lowered step by step as in `sim_backend.fem.finite`.
- The pulse is the exact slope by pressure at the mean of diastole and systole, times their
  difference: right to second order. How forces bend between the two is solved over the vessel.

The station nearest to the vessel is solved again on the usual mesh. What that changes corrects all
stations, and with what a correction was seen to leave (benchmarks/fleet.py) bounds their error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from sim_backend.fem.contact import finger_over
from sim_backend.fem.elements import as_element
from sim_backend.fem.finite import solve_finite
from sim_backend.fem.lumen import lumen_sides
from sim_backend.fem.mesh import block_mesh
from sim_backend.fem.newton import (
    CannotSolve,
    Load,
    Solution,
    _equilibrium,
    _Failed,
    march,
    pressure_slope,
    untouched,
)
from sim_backend.fem.section import (
    Section,
    _half_contact,
    _held,
    _materials,
    _ring,
    _sideways,
    best_element,
    build_section,
)
from sim_backend.response import element_size_m
from sim_backend.scene import Scene, SceneError
from sim_backend.waves import PA_PER_MMHG

Array = NDArray[np.float64]
Field = Callable[[Array], Array]

CONTACT_SHARE, WALL_SHARE, GROWTH, COARSEST_M = 0.08, 0.35, 0.6, 6e-3
"""Element size: in the contact over the finger's half width, at inclusions over their radius, how
fast it grows from there, and its end."""
CANONICAL_KPA = 50.0
"""Modulus at which the bare block is solved; any would do."""
PUSH = 8e-5
"""First guess of a touching node's push over the tissue's modulus [m]: it outweighs guessed gaps
below as many metres."""
FORCE_LEFT, PULSE_LEFT = 0.003, 0.02
"""What a correction leaves at most: of the force, and of the scan's largest pulse."""


@dataclass(frozen=True)
class QuickScan:
    """Per station (n,), the force [N] on the whole finger; NaN where ``reasons`` is not empty.

    ``force_n`` at diastole, ``pulse_n`` from there to systole, ``half_pulse_n`` to the mean of
    both pressures; ``force_error_n`` and ``pulse_error_n`` bound what they are off by.
    """

    x_m: Array
    force_n: Array
    pulse_n: Array
    half_pulse_n: Array
    force_error_n: Array
    pulse_error_n: Array
    reasons: tuple[str, ...]


def quick_scan(scene: Scene, x_m: Sequence[float], depth_m: float) -> QuickScan:
    """Press ``depth_m`` deep at each of ``x_m``, the lumens at their diastolic to systolic pressure.

    Raises `SceneError` for a lone vessel, and `CannotSolve` where filling the vessel or the station
    nearest to it meets a physical limit; elsewhere that is the station's reason.
    """
    if scene.tissue is None:
        raise SceneError(f"{scene.name}: a quick scan needs a block of tissue")
    x = np.asarray(x_m, dtype=float)
    low, high = (
        (scene.pulse.diastolic_mmhg * PA_PER_MMHG, scene.pulse.systolic_mmhg * PA_PER_MMHG)
        if scene.arteries else (0.0, 0.0)
    )  # fmt: skip
    middle, half = (low + high) / 2, (high - low) / 2
    centres = 1e-3 * np.array([one.x_mm for one in scene.inclusion or ()])
    nearest = (
        int(np.abs(x[:, None] - centres).min(axis=1).argmin()) if len(centres) else len(x) // 2
    )
    filled = _filled(scene, float(x[nearest]), depth_m, middle)
    over = _press(scene, _coarse(scene, float(x[nearest]), depth_m), depth_m, middle, filled)
    bend, ratio = _over_the_vessel(scene, over, depth_m, low, half)
    values, reasons = np.full((len(x), 2), np.nan), [""] * len(x)
    for k, place in enumerate(x):
        try:
            at = over if k == nearest else _press(
                scene, _coarse(scene, float(place), depth_m), depth_m, middle, filled
            )  # fmt: skip
            values[k] = at.solution.force_n_per_m, half * at.slope
        except CannotSolve as limit:
            reasons[k] = str(limit)
    length_m = 1e-3 * scene.indenter.length_mm
    force, swing = (length_m * ratio * values).T
    left = np.abs(ratio - 1)
    largest = 2 * float(np.nanmax(np.abs(swing)))
    pulse_error = PULSE_LEFT * largest + left[1] * np.abs(2 * swing)
    return QuickScan(
        x, force - (1 - bend) * swing, 2 * swing, (1 - bend) * swing,
        (FORCE_LEFT + left[0]) * force + pulse_error / 2 + abs(bend * swing), pulse_error,
        tuple(reasons),
    )  # fmt: skip


@dataclass(frozen=True)
class _Pressed:
    """``slope`` of the force by pressure [N/m/Pa]."""

    section: Section
    solution: Solution
    slope: float


def _press(
    scene: Scene, section: Section, depth_m: float, pressure_pa: float, more: Field
) -> _Pressed:
    """Solve a section, beginning with the bare block's answer and ``more`` displacements."""
    load = Load(depth_m, pressure_pa)
    try:
        solution = _equilibrium(section, _start(scene, section, load, more), load)
    except _Failed:
        steps = [Load(depth_m / 2, pressure_pa / 2), load]
        *_, solution = march(section, untouched(section), steps)
    slope = pressure_slope(section, solution)[1] if section.lumens else 0.0
    return _Pressed(section, solution, slope)


def _start(scene: Scene, section: Section, load: Load, more: Field) -> Solution:
    assert scene.tissue is not None
    nodes, surface = section.mesh.nodes, section.mesh.surface
    bare, half_m = _bare(_bare_scene(scene), load.depth_m)
    away = 0.5e-3 * scene.tissue.width_mm - section.finger.x
    held, weight = nodes[section.sideways.dofs[0] // 2], section.sideways.weight
    slid = 0.0  # the bare block was held under its finger; this one is held in its middle
    for _ in range(3):
        slid = -float(weight @ bare(held + [away + slid, 0.0])[:, 0])
    moved = bare(nodes + [away + slid, 0.0]) + [slid, 0.0] + more(nodes)
    touching = np.abs(nodes[surface, 0] + slid - section.finger.x) < half_m
    push = np.where(touching, PUSH * section.tissue_pa, 0.0)
    return Solution(load, moved, (push, np.zeros(len(section.mesh.resting))), 0.0, 0)


def _bare_scene(scene: Scene) -> Scene:
    assert scene.tissue is not None
    tissue = scene.tissue.model_copy(update={"modulus_kpa": CANONICAL_KPA})
    plain = {"name": "", "tissue": tissue, "inclusion": (), "pulse": type(scene.pulse)()}
    return scene.model_copy(update=plain)


@lru_cache(maxsize=8)
def _bare(scene: Scene, depth_m: float) -> tuple[Field, float]:
    """Displacements of the bare block pressed in its middle, and half the width of the contact."""
    assert scene.tissue is not None
    width = 1e-3 * scene.tissue.width_mm
    section, (solution,) = solve_finite(scene, width / 2, depth_m, [0.0], element_size_m(scene))
    touched = section.mesh.nodes[section.mesh.surface][solution.push[0] > 0, 0]
    field = LinearNDInterpolator(section.mesh.nodes, solution.displacement)

    def within(points: Array) -> Array:
        inside = np.clip(points[:, 0], 1e-9, width - 1e-9)
        return np.asarray(field(np.column_stack([inside, points[:, 1]])))

    return within, float(np.ptp(touched)) / 2


def _filled(scene: Scene, x_m: float, depth_m: float, pressure_pa: float) -> Field:
    """Displacements by the lumens' pressure alone."""
    if not scene.arteries:
        return lambda points: np.zeros_like(points)
    section = _coarse(scene, x_m, depth_m)
    (solution,) = march(section, untouched(section), [Load(-depth_m, pressure_pa)])
    field = LinearNDInterpolator(section.mesh.nodes, solution.displacement)
    return lambda points: np.asarray(field(points))


def _over_the_vessel(
    scene: Scene, over: _Pressed, depth_m: float, low_pa: float, half_pa: float
) -> tuple[float, Array]:
    """How far the force bends below the mean pressure's tangent, over the tangent's swing; and
    force and slope on the usual mesh over those of this one (2,)."""
    size_m = element_size_m(scene)
    usual = build_section(scene, over.section.finger.x, depth_m=depth_m, size_m=size_m)
    field = LinearNDInterpolator(over.section.mesh.nodes, over.solution.displacement)
    bare, _ = _bare(_bare_scene(scene), depth_m)
    del bare
    fine = _press(scene, usual, depth_m, low_pa + half_pa, field)
    force = fine.solution.force_n_per_m / over.solution.force_n_per_m
    if not over.slope:
        return 0.0, np.array([force, 1.0])
    (lowest,) = march(over.section, over.solution, [Load(depth_m, low_pa)])
    swing = half_pa * over.slope
    bend = (lowest.force_n_per_m - over.solution.force_n_per_m) / swing + 1
    return float(bend), np.array([force, fine.slope / over.slope])


def _coarse(scene: Scene, x_m: float, depth_m: float) -> Section:
    """As `sim_backend.fem.section.build_section`, with element sizes of this file."""
    assert scene.tissue is not None
    surface_m, half_m = 1e-3 * scene.surface_mm, 0.5e-3 * scene.indenter.width_mm_projected
    rings = [_ring(one, scene, n) for n, one in enumerate(scene.inclusion)]
    finger = finger_over(scene.indenter, x_m, surface_m)
    reach = _half_contact(finger, depth_m)

    def size(points: Array) -> Array:
        across = np.maximum(np.abs(points[:, 0] - x_m) - reach, 0.0)
        away = np.hypot(across, points[:, 1] - surface_m)
        wanted = CONTACT_SHARE * half_m + GROWTH * away
        for ring in rings:
            gap = np.abs(np.hypot(*(points - ring.centre).T) - ring.radii[0])
            wanted = np.minimum(wanted, WALL_SHARE * ring.radii[0] + GROWTH * gap)
        return np.minimum(wanted, COARSEST_M)

    plain = block_mesh(1e-3 * scene.tissue.width_mm, surface_m, rings, size)
    mesh, cells = as_element(plain, best_element(scene))
    shear, bulk = _materials(scene, rings, mesh.region)
    stress = scene.plane == "stress"
    return Section(
        mesh, cells, shear, bulk, stress, _held(mesh, scene),
        lumen_sides(mesh, cells, shear, bulk, stress), finger, 1e3 * scene.tissue.modulus_kpa,
        _sideways(mesh, scene),
    )  # fmt: skip
