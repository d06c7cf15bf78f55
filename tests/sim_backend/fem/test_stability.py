"""Unstable equilibria are seen and left; a press that has none is refused by its physics."""

from dataclasses import replace

import numpy as np
import pytest
from changed_scene import changed
from scipy.sparse.linalg import LinearOperator, eigs
from small_block import BLOCK
from small_solid import small_solid

from sim_backend import load_scene
from sim_backend.fem import continuation as following
from sim_backend.fem.axisymmetric import build_axisymmetric
from sim_backend.fem.continuation import continuation
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.limits import physical_limit
from sim_backend.fem.model import Grading, build_section, usual_grading
from sim_backend.fem.newton import (
    CannotSolve,
    Load,
    NotConverged,
    SkinPressedFlat,
    Solution,
    tangent,
    unloaded,
)
from sim_backend.fem.support import SlidingConstraint
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

BEAT_PA = [80 * PA_PER_MMHG, 120 * PA_PER_MMHG]


def supported(name: str, contact: str) -> Scene:
    return changed(name, support={"contact": contact})


def rolling(aside_m: float) -> Solution:
    """A lone vessel on its glued arc alone, which may roll, pressed 0.5 mm deep."""
    section = build_section(
        supported("HAOT", "frictionless"), 32e-3 + aside_m, depth_m=2.5e-3, size_m=0.4e-3
    )
    free = SlidingConstraint(np.empty((1, 0), dtype=np.int64), np.empty(0), 0.0)
    section = replace(section, sliding=free)
    loads = [Load(d, BEAT_PA[0]) for d in (0.0, 0.5e-3)]
    return list(continuation(section, unloaded(section), loads))[-1]


@pytest.mark.slow
def test_a_vessel_that_can_roll_is_found_rolled_also_from_right_above(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = rolling(0.0)
    assert found.stable
    assert found.force_n_per_m == pytest.approx(rolling(20e-6).force_n_per_m, rel=0.01)
    monkeypatch.setattr(following, "stable_branch", lambda _, unstable: unstable)
    balanced = rolling(0.0)
    assert not balanced.stable
    assert balanced.force_n_per_m > 1.1 * found.force_n_per_m


def test_an_unstable_state_without_a_stable_one_beside_it_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(following, "MAX_FALL", 0)
    with pytest.raises(CannotSolve, match="unstable"):
        rolling(0.0)


@pytest.mark.parametrize("contact", ["bonded", "frictionless"])
@pytest.mark.parametrize("name", ["HAOT", "SAOT"])
def test_a_lone_vessel_feels_the_same_a_little_aside(name: str, contact: str) -> None:
    scene = supported(name, contact)
    forces = []
    for x_m in (32e-3, 32.02e-3, 32.4e-3):
        section, solved = solve_finite(scene, x_m, 2.5e-3, BEAT_PA, 0.8e-3)
        assert all(one.stable for one in solved)
        factors = section.assembly.factor(tangent(section, solved[-1]).blocks)
        inverse = LinearOperator((section.size, section.size), factors.solve, dtype=float)
        (largest,) = eigs(inverse, k=1, return_eigenvectors=False)  # of the tangent's nearest to 0
        assert largest.real > 0
        forces.append([one.force_n_per_m for one in solved])
    middle, near, aside = np.array(forces)
    np.testing.assert_allclose(near, middle, rtol=1e-3)
    np.testing.assert_allclose(aside, middle, rtol=0.01)
    assert np.ptp(aside) == pytest.approx(np.ptp(middle), rel=0.02)


def test_a_block_that_may_lift_lifts_beside_the_finger_and_is_softer() -> None:
    (_, (fixed,)), (section, (free,)) = (
        solve_finite(scene, 32e-3, 2.5e-3, [0.0], 1e-3)
        for scene in (load_scene("TI"), changed("TI", support={"lifts": True}))
    )
    assert 0.7 * fixed.force_n_per_m < free.force_n_per_m < 0.99 * fixed.force_n_per_m
    bottom = section.mesh.resting
    height = free.displacement[bottom, 1]
    assert height.min() > -1e-9, "nothing sinks into the support"
    far = np.abs(section.mesh.nodes[bottom, 0] - 32e-3) > 28e-3
    assert (height[far] > 1e-6).all()
    assert (free.multiplier[1] >= 0).all(), "nothing is pulled down"


def column(plane: str, width_mm: float) -> Scene:
    """A narrow block 20 mm high, without friction, under a flat finger twice as wide."""
    raw = load_scene("TI").model_dump(mode="json", exclude_none=True) | {"plane": plane}
    raw["tissue"] |= {"width_mm": width_mm, "height_mm": 20.0}
    raw["indenter"] = {"shape": "flat", "width_mm": 2 * width_mm, "edge_radius_mm": 1.0}
    return Scene.model_validate(raw)


def aside_mm(solution: Solution) -> float:
    return 1e3 * float(np.abs(solution.displacement[:, 0].mean()))


@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("width_mm", [4.0, 6.0])
def test_a_column_buckles_where_euler_says(width_mm: float, plane: str) -> None:
    """Its ends stay level and may move aside: it shortens by pi^2 w^2 / (12 L^2) before."""
    buckling_m = np.pi**2 * width_mm**2 / (12 * 20.0**2) * 20e-3
    for share, low_mm, high_mm in ((0.95, 0.0, 0.01), (1.05, 0.5, 2.0)):
        _, (found,) = solve_finite(
            column(plane, width_mm), 0.5e-3 * width_mm, share * buckling_m, [0.0], 1e-3
        )
        assert found.stable
        assert low_mm <= aside_mm(found) < high_mm


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_a_straight_column_is_carried_to_a_finer_mesh_buckled(
    plane: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = column(plane, 6.0)
    monkeypatch.setattr(following, "stable_branch", lambda _, unstable: unstable)
    coarse = solve_finite(scene, 3e-3, 1.6e-3, [0.0], 2e-3)
    assert not coarse[1][0].stable
    assert aside_mm(coarse[1][0]) < 0.01
    monkeypatch.undo()
    _, (found,) = solve_finite(scene, 3e-3, 1.6e-3, [0.0], 1e-3, coarser=coarse)
    assert found.stable
    assert aside_mm(found) > 0.5
    assert found.force_n_per_m < 0.95 * coarse[1][0].force_n_per_m


def test_a_wall_that_is_filled_before_the_finger_touches_inflates() -> None:
    soft = changed("HAOT", inclusion={"modulus_kpa": 50.0})
    with pytest.raises(CannotSolve, match="inflates without bound") as refusal:
        solve_finite(soft, 32e-3, 0.5e-3, [150 * PA_PER_MMHG], 1e-3)
    assert refusal.value.limit == "limit pressure"


FILLED_PA = 12e3


@pytest.mark.parametrize("failure", [NotConverged("crushed"), SkinPressedFlat("pressed flat")])
@pytest.mark.parametrize("scene", [BLOCK, load_scene("HAOT")], ids=lambda one: one.name)
def test_a_refusal_names_no_negative_depth(scene: Scene, failure: NotConverged) -> None:
    x_m = 1e-3 * scene.inclusion[0].x_mm
    section = build_section(scene, x_m, depth_m=1e-3, size_m=0.5e-3)
    goal = Load(1e-3, FILLED_PA)

    def said(depth_m: float) -> str:
        last = replace(unloaded(section), load=Load(depth_m, FILLED_PA))
        return str(physical_limit(section, last, goal, failure))

    assert "found no equilibrium deeper than 0.3 mm" in said(0.3e-3)
    assert "found no equilibrium once the finger touches" in said(-0.1153e-3)
    assert "-0.1" not in said(-0.1153e-3)


def test_a_wall_bursts_where_it_does_and_not_where_steps_are_long() -> None:
    thin = {"modulus_kpa": 188.0, "wall_mm": 0.435, "depth_mm": 6.27}
    scene = changed("TIHA", inclusion=thin, tissue={"modulus_kpa": 10.3})
    depth_m, size_m = 1.391e-3, 0.18e-3
    section = build_section(
        scene, 31.64e-3, depth_m=depth_m, size_m=size_m, grading=usual_grading(size_m)
    )

    def force_n_per_m(*pressures_mmhg: float) -> float:
        loads = [Load(depth_m, p * PA_PER_MMHG) for p in pressures_mmhg]
        *_, last = continuation(section, unloaded(section), loads)
        return last.force_n_per_m

    small_steps = force_n_per_m(80, 140, 155, 160, 163, 166)
    assert force_n_per_m(80, 166) == pytest.approx(small_steps, rel=1e-6)


def test_a_body_of_revolution_is_crushed_at_a_radius() -> None:
    scene = small_solid(24.0, 24.0, height_mm=12.0, ball_mm=5.0)
    grading = Grading(0.5e-3, lambda radius: 0.3 * radius, 0.35, 4e-3)
    section = build_axisymmetric(scene, 12e-3, 1e-3, grading)
    last = replace(unloaded(section), load=Load(0.3e-3, 0.0))
    said = str(physical_limit(section, last, Load(1e-3, 0.0), NotConverged("crushed")))
    assert " at r = " in said
    assert "x = " not in said
