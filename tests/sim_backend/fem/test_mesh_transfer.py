"""An answer that begins on a coarser mesh is the answer."""

from dataclasses import replace

import numpy as np
import pytest
from changed_scene import changed
from small_block import BLOCK

from sim_backend.fem.contact.lumen_self_contact import wall_gaps
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.mesh_transfer import continued
from sim_backend.fem.newton import PAIRS_WITH_OPEN_LUMENS, NotConverged
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

LEVELS_PA = [80 * PA_PER_MMHG, 120 * PA_PER_MMHG]
THROUGH_M = 1e-7
"""Of a lumen of 3 mm: rounding of the equilibrium."""
FLAT = {"shape": "flat", "width_mm": 6.0, "edge_radius_mm": 1.0}


def scene(plane: str, indenter: dict[str, object] | None = None, **artery: float) -> Scene:
    there = changed(BLOCK, plane=plane, inclusion=artery)
    return Scene.model_validate(there.model_dump() | ({"indenter": indenter} if indenter else {}))


@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("indenter", [None, FLAT, FLAT | {"bonded": True}])
def test_it_is_what_a_ramp_on_the_finer_mesh_finds(
    plane: str, indenter: dict[str, object] | None
) -> None:
    here = scene(plane, indenter)
    coarse = solve_finite(here, 0.011, 1.5e-3, LEVELS_PA, 1.2e-3)
    section, ramped = solve_finite(here, 0.011, 1.5e-3, LEVELS_PA, 0.6e-3)
    _, nested = solve_finite(here, 0.011, 1.5e-3, LEVELS_PA, 0.6e-3, coarser=coarse)
    if plane == "stress":  # else a ramp may be needed: interpolated volume changes are stiff
        assert continued(coarse[0], coarse[1][0], section).iterations <= 12
    # what a bonded finger has gripped depends on the way down, a little
    exact = 1e-2 if indenter and "bonded" in indenter else 1e-5
    for one, other in zip(nested, ramped, strict=True):
        assert one.force_n_per_m == pytest.approx(other.force_n_per_m, rel=exact)


def test_a_lumen_that_is_shut_stays_shut_and_its_walls_push_back() -> None:
    soft = scene("stress", modulus_kpa=40.0, depth_mm=3.5, wall_mm=0.5)
    coarse = solve_finite(soft, 0.012, 3.0e-3, [0.0], 0.8e-3)
    fine = solve_finite(soft, 0.012, 3.0e-3, [0.0], 0.55e-3, coarser=coarse)
    for section, (solution,) in (coarse, fine):
        assert len(solution.multiplier) > PAIRS_WITH_OPEN_LUMENS, "its walls touch"
        place = section.mesh.nodes + solution.displacement
        (gap,) = (wall_gaps(walls, place[walls.nodes])[0] for walls in section.walls)
        assert gap.min() > -THROUGH_M, "its walls have passed through each other"
        (pushes,) = solution.multiplier[PAIRS_WITH_OPEN_LUMENS:]
        assert pushes.max() > 0, "nothing keeps them apart"
        assert gap[pushes > 0].max() < THROUGH_M, "walls that are apart push"
    assert fine[1][0].force_n_per_m == pytest.approx(coarse[1][0].force_n_per_m, rel=0.03)


def test_a_wild_beginning_is_reported_and_a_ramp_is_taken_instead() -> None:
    here = scene("stress")
    section, (good, _) = solve_finite(here, 0.012, 1.0e-3, LEVELS_PA, 1.0e-3)
    rng = np.random.default_rng(1)
    wild = replace(good, displacement=2e-3 * rng.standard_normal(good.displacement.shape))
    with pytest.raises(NotConverged):
        continued(section, wild, section)
    _, (found, _) = solve_finite(here, 0.012, 1.0e-3, LEVELS_PA, 1.0e-3,
                                 coarser=(section, [wild, wild]))  # fmt: skip
    assert found.force_n_per_m == pytest.approx(good.force_n_per_m, rel=1e-6)
