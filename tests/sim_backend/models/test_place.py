"""What is left out is left out because it is not felt, whatever the shape of scene and finger."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.small_strain import solve_small
from sim_backend.models import section_meshes
from sim_backend.models.place import place
from sim_backend.models.press import press
from sim_backend.models.refine import refine
from sim_backend.models.section_meshes import SectionMeshes
from sim_backend.models.table import far_error_pct
from sim_backend.scene.scene_file import Scene, SceneError, load_scene

ROUND = {"shape": "cylinder", "radius_mm": 5.0}
WIDE = {"shape": "flat", "width_mm": 30.0, "edge_radius_mm": 2.0}
LUMP = {"kind": "tumour", "x_mm": 42.0, "depth_mm": 4.0, "diameter_mm": 5.0,
        "modulus_kpa": 1000.0, "poisson": 0.45}  # fmt: skip


def block(height_mm: float, indenter: dict[str, object], *inclusion: dict[str, object]) -> Scene:
    tissue = {"width_mm": 64.0, "height_mm": height_mm, "modulus_kpa": 50.0, "poisson": 0.45}
    return Scene.model_validate({"name": "block", "tissue": tissue, "indenter": indenter,
                                 "inclusion": inclusion})  # fmt: skip


@pytest.mark.parametrize(("depth_mm", "budget_pct"), [(0.2, 1.0), (0.8, 1.0), (0.8, 50.0)])
def test_an_inclusion_under_a_wide_finger_stays(depth_mm: float, budget_pct: float) -> None:
    """Far from the finger's centre, in a thin block: without it the force is 19 % lower. A model
    may take half of the budget, at twice its effect."""
    scene = block(8.0, WIDE, LUMP)
    pressed = place(scene, 32e-3).solve(1e-3 * depth_mm, accuracy_pct=budget_pct)
    assert pressed.left_out == 0


@pytest.mark.parametrize("away_mm", [8.0, 10.0, 12.0])
def test_the_rule_for_far_inclusions_states_twice_what_they_do(away_mm: float) -> None:
    """A hard lump as deep as the paper's, ``away_mm`` beside a deep press; not fifty times, or
    nothing would ever be left out."""
    scene = load_scene("TIT")
    one = scene.inclusion[0]
    aside = one.model_copy(update={"x_mm": 20.0 + away_mm + one.outer_radius_mm})
    whole, bare = (scene.model_copy(update={"inclusion": i}) for i in ((aside,), ()))
    with_it, without = (
        solve_finite(each, 20e-3, 2.5e-3, [0.0], 0.7e-3)[1][0].force_n_per_m
        for each in (whole, bare)
    )
    effect_pct = 100 * abs(without / with_it - 1)
    assert 2 * effect_pct <= far_error_pct(whole, aside, 20.0) <= 10 * effect_pct


def test_small_strain_costs_at_most_what_is_stated() -> None:
    """On a thin block, where it is the measured effect that counts, taken twice."""
    scene, depth_mm = block(2.0, {"shape": "cylinder", "radius_mm": 20.0}), 0.1
    pressed = place(scene, 32e-3).solve(1e-3 * depth_mm, accuracy_pct=40.0)
    small, finite = (
        solve(scene, 32e-3, 1e-3 * depth_mm, [0.0], 0.5e-3)[1][0].force_n_per_m
        for solve in (solve_small, solve_finite)
    )
    assert pressed.model == "small"
    assert 150 * abs(small / finite - 1) < pressed.error_pct[0]


@pytest.mark.parametrize("indenter", [WIDE, {"shape": "cylinder", "radius_mm": 20.0}])
def test_a_thin_block_is_not_taken_at_small_strain(indenter: dict[str, object]) -> None:
    """Shallow beside the finger, deep beside the block: small strain misses 14 % of the force."""
    assert place(block(2.0, indenter), 32e-3).solve(0.3e-3).model == "finite"


def test_what_is_not_felt_is_left_out_and_counted() -> None:
    far = LUMP | {"x_mm": 58.0, "diameter_mm": 3.0}
    pressed = place(block(16.83, ROUND, far), 16e-3).solve(0.1e-3)
    assert (pressed.model, pressed.left_out) == ("small", 1)
    assert 0.0 < pressed.error_pct[0] <= 1.0


@pytest.mark.parametrize(
    ("height_mm", "indenter", "depth_mm", "model"), [(8.0, ROUND, 0.1, "small"),
                                                    (2.0, WIDE, 0.3, "finite")])  # fmt: skip
def test_the_first_mesh_is_solved_once(
    monkeypatch: pytest.MonkeyPatch,
    height_mm: float,
    indenter: dict[str, object],
    depth_mm: float,
    model: str,
) -> None:
    """What told that small strain will do, or will not, is where the refinement begins."""
    scene, budget_pct = block(height_mm, indenter), 5.0
    asked: list[tuple[object, ...]] = []

    def counted(solve: Callable[..., Any]) -> Callable[..., Any]:
        def one(*place: Any, **given: Any) -> Any:
            asked.append((solve, place[0], place[4]))
            return solve(*place, **given)

        return one

    monkeypatch.setattr(section_meshes, "solve_small", counted(solve_small))
    monkeypatch.setattr(section_meshes, "solve_finite", counted(solve_finite))
    pressed = press(scene, 32.0, depth_mm, (0.0,), accuracy_pct=budget_pct)
    assert pressed.model == model
    assert len(set(asked)) == len(asked) > 2
    meshes = SectionMeshes(model, scene, 32e-3, 1e-3 * depth_mm, [0.0])
    same = 1e-3 * refine(meshes, np.full(2, budget_pct)).solved[1][0].force
    assert pressed.states[0].force_n_per_mm == pytest.approx(same, rel=1e-12)


def test_a_gradient_is_known_of_what_was_solved_at_finite_strain_only() -> None:
    here = place(load_scene("TI"), 32e-3)
    step_m = 1e-3 * here.solve(0.1e-3, model="finite").gradient["depth_mm"][0]
    assert step_m > 0
    with pytest.raises(SceneError, match="no gradient is known of a press by small"):
        _ = here.solve(0.1e-3, model="small").gradient


def test_the_dearer_model_follows_where_the_cheaper_one_is_too_rough() -> None:
    """Round blocks within and around a narrow one differ by more than is asked for."""
    scene = Scene.model_validate({
        "name": "narrow", "plane": "solid", "indenter": {"shape": "sphere", "radius_mm": 4.0},
        "tissue": {"width_mm": 12.0, "height_mm": 8.0, "length_mm": 12.0, "modulus_kpa": 50.0,
                   "poisson": 0.45}})  # fmt: skip
    rough = place(scene, 6e-3).solve(0.5e-3, model="axisymmetric")
    fine = place(scene, 6e-3).solve(0.5e-3, accuracy_pct=0.9 * rough.error_pct[0])
    assert (rough.model, fine.model) == ("axisymmetric", "solid")
    assert abs(rough.force_n[0] / fine.force_n[0] - 1) < 0.01 * rough.error_pct[0]
    assert "axisymmetric would leave" in fine.why


@pytest.mark.parametrize("bonded", [False, True])
def test_a_ramp_says_at_each_depth_what_presses_say(bonded: bool) -> None:
    """A bonded finger's answer is its path's; two depths alone would be two steps of it."""
    finger = {"shape": "cylinder", "radius_mm": 5.0, "bonded": bonded}
    scene = Scene.model_validate(load_scene("TIHA").model_dump() | {"indenter": finger})
    beat_pa = [10e3, 16e3]
    for solved, depth_m in zip(place(scene, 29e-3).ramp([0.5e-3, 1.5e-3], beat_pa),
                               (0.5e-3, 1.5e-3), strict=True):  # fmt: skip
        pressed = place(scene, 29e-3).solve(depth_m, beat_pa, accuracy_pct=0.5)
        assert solved.force_n == pytest.approx(pressed.force_n, rel=0.01)
        assert np.ptp(solved.force_n) == pytest.approx(np.ptp(pressed.force_n), rel=0.05)
        assert solved.contact_m[:, :2] == pytest.approx(pressed.contact_m[:, :2], abs=0.3e-3)
