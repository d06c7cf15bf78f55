"""Skins, bonded contact and lumens that close, in solids as in sections."""

from typing import Any

import numpy as np
import pytest
from changed_scene import changed
from small_solid import small_solid

from sim_backend.fem.axisymmetric import solve_axisymmetric
from sim_backend.fem.model import usual_grading
from sim_backend.fem.newton import PAIRS_WITH_OPEN_LUMENS, CannotSolve
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

DEPTH_M = 0.6e-3


def block(indenter: dict[str, Any] | None = None, poisson: float = 0.49, **changed: Any) -> Scene:
    finger = {"shape": "sphere", "radius_mm": 5.0} | (indenter or {})
    scene = small_solid(24.0, 20.0, height_mm=12.0, poisson=poisson, indenter=finger)
    return Scene.model_validate(scene.model_dump(exclude_none=True) | changed)


def force_n(scene: Scene, depth_m: float = DEPTH_M, size_m: float = 1.2e-3) -> float:
    _, (found,) = solve_solid(scene, 12e-3, depth_m, [0.0], size_m)
    return found.force_n


def test_a_skin_on_hard_tissue_is_an_elastic_foundation() -> None:
    """Each point yields along the ball's normal by its pressure alone: F = pi (R - d) d^2 / c,
    the integral of gap over c, upwards (Johnson 1985, sec. 4.3)."""
    skin = {"thickness_mm": 1.0, "modulus_kpa": 20.0, "poisson": 0.3}
    scene = block({"skin": skin})
    hard_scene = changed(scene, tissue={"modulus_kpa": 2e5})
    confined_pa = 0.7 / (1.3 * 0.4) * 20e3
    depth_m = 0.4e-3
    expected = np.pi * (5e-3 - depth_m) * depth_m**2 * confined_pa / 1e-3
    assert force_n(hard_scene, depth_m, 0.7e-3) == pytest.approx(expected, rel=0.02)
    assert force_n(scene) < 0.9 * force_n(block())


def test_a_skin_pressed_flat_is_refused() -> None:
    skin = {"thickness_mm": 0.3, "modulus_kpa": 1.0}
    with pytest.raises(CannotSolve, match="skin is pressed by") as refusal:
        force_n(block({"skin": skin}), 1.5e-3)
    assert refusal.value.limit == "skin"


@pytest.mark.parametrize("indenter, changed", [
    ({"bonded": True}, {}), ({}, {"support": {"contact": "bonded"}}),
], ids=["finger", "support"])  # fmt: skip
def test_what_sticks_is_held_as_in_a_body_of_revolution(
    indenter: dict[str, Any], changed: dict[str, Any]
) -> None:
    grading = usual_grading(0.35e-3)

    def round_n(scene: Scene) -> float:
        _, (found,) = solve_axisymmetric(scene, 12e-3, DEPTH_M, grading)
        return found.force_n

    sliding, sticking = block(poisson=0.0), block(indenter, 0.0, **changed)
    solid = force_n(sticking, size_m=0.7e-3) / force_n(sliding, size_m=0.7e-3)
    assert solid > 1.005
    assert solid - 1 == pytest.approx(round_n(sticking) / round_n(sliding) - 1, rel=0.3)


def test_the_walls_of_a_lumen_that_is_pressed_shut_meet() -> None:
    vein = {"kind": "artery", "x_mm": 12.0, "depth_mm": 6.0, "inner_diameter_mm": 4.0,
            "wall_mm": 0.4, "modulus_kpa": 60.0, "poisson": 0.49}  # fmt: skip
    body, (found,) = solve_solid(block(inclusion=[vein]), 12e-3, 7e-3, [0.0], 1.8e-3)
    pushes = found.multiplier[PAIRS_WITH_OPEN_LUMENS:]
    assert sum(float(m.sum()) for m in pushes) > 0
    closed = body.with_self_contact
    for pairs in closed.contact_pairs(found.displacement, 7e-3)[PAIRS_WITH_OPEN_LUMENS:]:
        assert pairs.gap.min() > -1e-3 * body.contact_m


@pytest.mark.slow
def test_a_soft_wall_is_filled_until_it_bursts_and_not_until_factors_are_inexact() -> None:
    scene = Scene.model_validate(
        {"name": "soft wall", "plane": "solid",
         "tissue": {"width_mm": 22.048653881187303, "height_mm": 12.283367832041867,
                    "length_mm": 19.70844487173376, "modulus_kpa": 28.225084096756397,
                    "poisson": 0.49},
         "inclusion": [{"kind": "artery", "inner_diameter_mm": 3.501743368866287,
                        "wall_mm": 0.38698169340257665, "modulus_kpa": 100.0, "poisson": 0.49,
                        "x_mm": 11.024326940593651, "depth_mm": 8.027318003881799}],
         "indenter": {"shape": "sphere", "radius_mm": 3.0656861164998235}}
    )  # fmt: skip
    pressures_pa = [p * PA_PER_MMHG for p in (80.0, 118.0, 120.0)]
    size_m = 0.36 * 3.0656861164998235e-3
    _, found = solve_solid(
        scene, 11.80672279278754e-3, 1.9709879382028375e-3, pressures_pa, size_m, judge=False
    )
    low, near, high = (one.force_n for one in found)
    assert high / near - 1 == pytest.approx(2 / 38 * (near / low - 1), rel=0.5)
