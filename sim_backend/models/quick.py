"""A press at finite strain on the mesh of a scan's stations, at the least cost.

Newton starts from the bare block's own answer, which presses share (its displacements do not depend
on its modulus), moved under the finger, plus the vessel's answer to its pressure alone. Where that
start fails, the finger is lowered step by step as in `sim_backend.fem.finite_strain`.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.continuation import continuation
from sim_backend.fem.field import Field
from sim_backend.fem.finite_strain import down, filled, solve_finite
from sim_backend.fem.lumen import flatness
from sim_backend.fem.newton import Load, NotConverged, Solution, equilibrium
from sim_backend.fem.section import Section
from sim_backend.models.section_meshes import entering_pct, steepness
from sim_backend.models.stations import LEFT, element_size_m, section_for
from sim_backend.scene.scene_file import Scene

CANONICAL_KPA = 50.0
"""Modulus at which the bare block is solved; any would do."""
TOUCHING_SHARE = 0.02
"""First guess of the contact: nodes this near to the finger, over its half width. As much times the
tissue's modulus is the guess of their force."""


def solve_quick(
    scene: Scene, x_m: float, depth_m: float, pressures_pa: Sequence[float]
) -> tuple[Section, list[Solution], Array]:
    """The press into a block, and its errors (force, pulse) [%], which are those of stations.
    Raises `CannotSolve`."""
    section = section_for(scene, x_m, depth_m)
    first = Load(depth_m, pressures_pa[0] if section.lumens else 0.0)
    start, _ = filled(section, first.pressure_pa, depth_m)
    states = [_pressed(scene, section, start, first)]
    loads = [Load(depth_m, p) for p in pressures_pa[1:]]
    states += continuation(section, states[0], loads)
    flat = max(flatness(section.lumens, state.displacement) for state in states)
    by_force, by_pulse = steepness(section, states, pressures_pa)
    change_pct = 100 * LEFT.change * flat**2
    pulse_pct = change_pct * by_pulse + (entering_pct(states) if len(states) > 1 else 0.0)
    return section, states, np.array([100 * LEFT.rest + change_pct * by_force, pulse_pct])


def _pressed(scene: Scene, section: Section, start: Solution, load: Load) -> Solution:
    """From the guess; where that fails, or presses the walls of a vessel through each other, step
    by step from the ``start``, over which the finger hangs."""
    if scene.tissue is None or section.bonded:  # the answer is its path's
        return next(down(section, start, [load]))
    guess = _bare_block(scene, section, load.depth_m) + start.displacement
    surface = section.mesh.surface
    lowered = section.finger.lowered_to(section.finger.y - load.depth_m)
    gap, _, _ = lowered.gap((section.mesh.nodes + guess)[surface])
    near_m = TOUCHING_SHARE * section.finger.profile.half_width
    multiplier = np.where(gap < near_m, near_m * section.tissue_pa, 0.0)
    begin = Solution(load, guess, (multiplier, np.zeros(len(section.mesh.resting))), 0.0, 0)
    try:
        state = equilibrium(section, begin, load)
        if state.stable and not section.walls_cross(state.displacement):
            return state
    except NotConverged:
        pass
    return next(down(section, start, [load]))


def _bare_block(scene: Scene, section: Section, depth_m: float) -> Array:
    """Displacements (n, 2) [m] of the scene's block alone, pressed in its middle and moved under
    the finger."""
    assert scene.tissue is not None
    tissue = scene.tissue.model_copy(update={"modulus_kpa": CANONICAL_KPA})
    plain = Scene(name="bare", plane=scene.plane, tissue=tissue, indenter=scene.indenter)
    field, width = _bare_field(plain, depth_m), 1e-3 * tissue.width_mm
    nodes, bottom = section.mesh.nodes, section.sliding.dofs[0] // 2

    def moved(points: Array, slid: float) -> Array:
        across = np.clip(points[:, 0] + slid + width / 2 - section.finger.x, 1e-9, width - 1e-9)
        placed = field(np.column_stack([across, points[:, 1]]))
        placed[:, 0] += slid
        return placed

    slid = 0.0  # the bare block was fixed under its finger, this one is fixed in its middle
    for _ in range(3):
        slid -= float(section.sliding.weight @ moved(nodes[bottom], slid)[:, 0])
    return moved(nodes, slid)


@lru_cache(maxsize=8)
def _bare_field(scene: Scene, depth_m: float) -> Field:
    """Displacements of a block without inclusions, pressed in its middle."""
    assert scene.tissue is not None
    middle_m = 0.5e-3 * scene.tissue.width_mm
    section, (state,) = solve_finite(scene, middle_m, depth_m, [0.0], element_size_m(scene))
    return Field(section.mesh.nodes, state.displacement)
