"""A press into a solid scene: meshes refined until force and pulse converge."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.contact.finger_gaps import finger_over
from sim_backend.fem.model import half_contact
from sim_backend.fem.newton import CannotSolve, Solution
from sim_backend.fem.section import Section
from sim_backend.fem.solid.build import MOST_UNKNOWNS, half_width_m
from sim_backend.fem.solid.solve import SolvedSolid, solve_solid
from sim_backend.models.refine import ORDER, Solving, changes_pct, mesh_in_words, refine
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.taxels import TaxelArray

SHARES = (0.36, 0.25, 0.18)
"""Element sizes in the contact over the finger's smaller half width, one mesh after the other."""
GROWTH = (2.7, 1.6)
"""Powers of the elements in the contact by which unknowns grow from mesh to mesh: 2.0 to 2.7 and
0.8 to 2.0 of eleven scenes."""
FLOOR_PCT = 30.0
"""What a mesh misses of force and of pulse at least, over the square of its share: two meshes may
agree by chance. Two meshes of an earlier commit did, under a cylinder of 5 x 10 mm over TIHA's
vessel: within 0.1 % of force and 0.4 % of pulse, both 1.7 and 2.0 % above a finer one. In a block
of 24 x 20 mm the third mesh's pulse, like CalculiX', is 1.6 % above the second's.
"""
TAXEL_ELEMENTS = 1.5
"""Narrowest taxel of a solid over the elements of its second mesh. Under a ball of 4 mm on a block
of 24 x 24 x 12 mm, 1 mm deep, taxels of 1.5 to 3 elements are within 3.3 % of the largest of those
of the body of revolution, and of 1 element they are 4.4 % lopsided."""
SOLID = "a solid in three dimensions"


def refine_solid(
    scene: Scene,
    x_m: float,
    depth_m: float,
    pressures_pa: Sequence[float],
    budget_pct: Array,
    solving: Solving = lambda _what: None,
) -> tuple[SolvedSolid, Array]:
    """The finest solution needed for ``budget_pct`` (force, pulse), and what is left of both errors
    [%]. ``solving`` receives a line about each mesh before it is solved. Raises `CannotSolve`."""
    half_m = half_width_m(scene)
    error_pct = np.full(2, np.inf)
    solving(mesh_in_words(SOLID, SHARES[0] * half_m, error_pct))
    # no first mesh without a second, which shows its error; how large finer ones are is foreseen
    most = MOST_UNKNOWNS * (SHARES[1] / SHARES[0]) ** GROWTH[0]
    solved = solve_solid(
        scene, x_m, depth_m, pressures_pa, SHARES[0] * half_m, most_unknowns=most, judge=False
    )
    for (before, share), growth in zip(pairwise(SHARES), GROWTH, strict=True):
        finer = before / share
        if len(solved[0].free) * finer**growth > MOST_UNKNOWNS:
            break
        coarser = solved
        solving(mesh_in_words(SOLID, share * half_m, error_pct))
        try:
            solved = solve_solid(
                scene, x_m, depth_m, pressures_pa, share * half_m, coarser=coarser,
                most_unknowns=np.inf,
            )  # fmt: skip
        except CannotSolve:
            if np.isinf(error_pct).any():
                raise
            break
        least_pct = FLOOR_PCT * share**2 * np.array([1.0, len(pressures_pa) > 1])
        a, b = (np.array([one.force_n for one in each]) for _, each in (coarser, solved))
        error_pct = np.maximum(changes_pct(a, b) / (finer**ORDER - 1), least_pct)
        if (error_pct <= budget_pct).all():
            break
    return solved, error_pct


def need_wide_taxels(scene: Scene, taxels: TaxelArray) -> None:
    """Raise `SceneError` for taxels narrower than a solid's elements can tell apart."""
    across_m, along_m = taxels.edges_m(scene.indenter)
    narrowest_m = min(float(across_m[1] - across_m[0]), float(along_m[1] - along_m[0]))
    least_m = TAXEL_ELEMENTS * SHARES[1] * half_width_m(scene)
    if narrowest_m < least_m:
        raise SceneError(
            f"{scene.name}: taxels of {1e3 * narrowest_m:.2g} mm are finer than a solid's elements "
            f"can tell apart under this finger; take a pitch of {1e3 * least_m:.2g} mm or more, or "
            'press a plane section (plane = "strain")'
        )


def round_radii_m(scene: Scene, x_m: float) -> tuple[float, float]:
    """Radii [m] of the round block about ``x_m`` that fits into the scene's, and of the one that
    holds it."""
    tissue = scene.tissue
    assert tissue is not None and tissue.length_mm is not None
    across = x_m, 1e-3 * tissue.width_mm - x_m
    half_m, aside_m = 0.5e-3 * tissue.length_mm, 1e-3 * abs(tissue.z_mm or 0.0)
    inner = min(*across, half_m - aside_m)
    return inner, float(np.hypot(max(across), half_m + aside_m))


def least_round_m(scene: Scene, depth_m: float) -> float:
    """Least radius [m] of a round block that says anything of a press ``depth_m`` deep: half of the
    width that it touches.

    A narrower one is a column that the finger squeezes whole: of a ball of 4 mm over a block of
    24 x 20 mm, 0.2 and 1 mm deep, half the difference of both round blocks is 73 and 55 % of the
    force there; 100 % right over the side, where the one that fits is a line.
    """
    finger = finger_over(scene.indenter, 0.0, 1e-3 * scene.surface_mm)
    return half_contact(finger, depth_m)


def holds_a_round_block(scene: Scene, x_m: float, depth_m: float) -> bool:
    """Whether a round block that says something of the press fits into the scene's."""
    return round_radii_m(scene, x_m)[0] >= least_round_m(scene, depth_m)


def refine_axisymmetric(
    scene: Scene,
    x_m: float,
    depth_m: float,
    accuracy_pct: float,
    solving: Solving = lambda _what: None,
) -> tuple[Section, Solution, float]:
    """A press over round things by a body of revolution, its force and its error [%].

    The block lies between the round one that fits into it and the round one that holds it. The
    force is the mean of both; half of their difference is the block's part of the error.
    Raises `SceneError` nearer to a side or an end than `least_round_m`, and `CannotSolve`.
    """
    inner, outer = round_radii_m(scene, x_m)
    if inner < (least := least_round_m(scene, depth_m)):
        raise SceneError(
            f"model = 'axisymmetric': {1e3 * inner:.3g} mm from a side or an end of {scene.name}, "
            f"less than the {1e3 * least:.3g} mm that the finger touches to either side: press "
            "further inside, or take model = 'solid'"
        )
    budget = np.array([max(0.3 * accuracy_pct, 0.05), np.inf])
    press = depth_m, [0.0], budget
    small = refine("axisymmetric", scene, inner, *press, solving=solving)
    large = refine("axisymmetric", scene, outer, *press, small.solved, solving=solving)
    (section, (low,)), (_, (high,)) = small.solved, large.solved
    forces = np.array([low.force_n_per_m, high.force_n_per_m])  # of a whole turn: newtons
    force_n = float(forces.mean())
    block_pct = 50 * abs(float(np.ptp(forces))) / max(abs(force_n), 1e-12)
    mesh_pct = max(float(small.error_pct[0]), float(large.error_pct[0]))
    return section, replace(low, force=force_n), block_pct + mesh_pct
