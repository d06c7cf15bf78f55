"""A press over round things as a body of revolution: between two round blocks lies the true one."""

from dataclasses import replace

import numpy as np

from sim_backend.fem.axisymmetric import is_round
from sim_backend.fem.contact.finger_gaps import finger_over
from sim_backend.fem.model import half_contact
from sim_backend.models.refine import Asked, Refined, refine
from sim_backend.models.section_meshes import SectionMeshes
from sim_backend.scene.scene_file import Scene, SceneError


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


def holds_a_round_block(asked: Asked) -> bool:
    """Whether all is round about the place, and a round block that says something of the press fits
    into the scene's."""
    scene, x_m = asked.scene, asked.x_m
    return is_round(scene, x_m) and round_radii_m(scene, x_m)[0] >= least_round_m(
        scene, asked.depth_m
    )


def refine_axisymmetric(asked: Asked) -> Refined:
    """A press over round things by a body of revolution.

    The block lies between the round one that fits into it and the round one that holds it. The
    force is the mean of both; half of their difference is the block's part of the error. Raises
    `SceneError` where nothing is round or nearer to a side or an end than `least_round_m`, and
    `CannotSolve`.
    """
    scene = asked.scene
    if not is_round(scene, asked.x_m):
        raise SceneError(
            f"model = 'axisymmetric': scene {scene.name} is a solid, to be solved as solid, "
            "or as axisymmetric under a sphere or a round flat, over nothing or over one ball "
            "right below"
        )
    radii = inner, _ = round_radii_m(scene, asked.x_m)
    if inner < (least := least_round_m(scene, asked.depth_m)):
        raise SceneError(
            f"model = 'axisymmetric': {1e3 * inner:.3g} mm from a side or an end of {scene.name}, "
            f"less than the {1e3 * least:.3g} mm that the finger touches to either side: press "
            "further inside, or take model = 'solid'"
        )
    budget = np.array([max(0.3 * asked.accuracy_pct, 0.05), np.inf])
    empty = replace(asked, pressures_pa=(0.0,))
    blocks = [SectionMeshes(replace(empty, x_m=r), "axisymmetric") for r in radii]
    small = refine(blocks[0], budget)
    large = refine(blocks[1], budget, small.solved)
    (section, (low,)), (_, (high,)) = small.solved, large.solved
    forces = np.array([low.force, high.force])
    force_n = float(forces.mean())
    block_pct = 50 * abs(float(np.ptp(forces))) / max(abs(force_n), 1e-12)
    mesh_pct = max(float(small.error_pct[0]), float(large.error_pct[0]))
    states = [replace(low, force=force_n)] * len(asked.pressures_pa)
    return Refined((section, states), np.array([block_pct + mesh_pct, 0.0]))
