"""What the error of a press into a solid is made of."""

from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from changed_scene import changed
from own_scene import BALL

from sim_backend import load_scene
from sim_backend.fem.model import best_element
from sim_backend.fem.solid.build import build_body, half_width_m
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.models import round_press, solid_meshes, table
from sim_backend.models.press import press
from sim_backend.models.refine import Asked, Refined, refine
from sim_backend.models.solid_meshes import SHARES, SolidMeshes
from sim_backend.scene.scene_file import SceneError, scene_from_text


@dataclass(frozen=True)
class Solved:
    force: float


def test_both_round_blocks_lie_within_the_stated_error(monkeypatch: pytest.MonkeyPatch) -> None:
    forces_n = iter((0.9, 1.1))

    def refined(*_given: Any, **_more: Any) -> SimpleNamespace:
        return SimpleNamespace(solved=(None, (Solved(next(forces_n)),)), error_pct=np.zeros(2))

    monkeypatch.setattr(round_press, "refine", refined)
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    refined = round_press.refine_axisymmetric(Asked(scene, 32e-3, 1e-3))
    assert refined.solved[1][0].force == pytest.approx(1.0)
    assert refined.error_pct == pytest.approx([10.0, 0.0])


@pytest.mark.parametrize("pressures_pa", [(0.0,), (80.0, 120.0)])
def test_meshes_that_agree_by_chance_do_not_state_no_error(
    pressures_pa: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def solved(*_given: Any, **_more: Any) -> tuple[SimpleNamespace, list[SimpleNamespace]]:
        return SimpleNamespace(free=range(10)), [SimpleNamespace(force=1 + p) for p in pressures_pa]

    monkeypatch.setattr(solid_meshes, "solve_solid", solved)
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    meshes = SolidMeshes(Asked(scene, 0.0, 1e-3, pressures_pa))
    force_pct, pulse_pct = refine(meshes, np.full(2, 5.0)).error_pct
    assert 1.7 < force_pct < 3.0  # a cylinder's second mesh missed as much
    assert 1.7 < pulse_pct < 3.0 if len(pressures_pa) > 1 else pulse_pct == 0.0


@pytest.mark.parametrize(("second", "meshes"), [(50_000, 3), (51_000, 2)])
def test_no_mesh_is_begun_that_would_be_too_large(
    second: int, meshes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The third mesh has about 1.7 times as many unknowns as the second, and may have 85,000."""
    sizes_m: list[float] = []

    def solved(*given: Any, **_more: Any) -> tuple[SimpleNamespace, list[SimpleNamespace]]:
        sizes_m.append(given[4])
        unknowns = second if len(sizes_m) == 2 else 10
        return SimpleNamespace(free=range(unknowns)), [SimpleNamespace(force=1.0)]

    monkeypatch.setattr(solid_meshes, "solve_solid", solved)
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    refine(SolidMeshes(Asked(scene, 0.0, 1e-3)), np.full(2, 1.0))
    assert len(sizes_m) == meshes


@pytest.mark.parametrize("name", ["TIHA-solid", "TIT-solid", "TISA-solid"])
def test_how_large_a_mesh_will_be_is_foreseen(name: str) -> None:
    scene = load_scene(name)
    unknowns = [
        len(build_body(scene, 32e-3, depth_m=2e-3, size_m=share * half_width_m(scene)).free)
        for share in SHARES
    ]
    steps = zip(pairwise(unknowns), pairwise(SHARES), solid_meshes.GROWTH, strict=True)
    for (before, after), (coarse, fine), growth in steps:
        foreseen = before * (coarse / fine) ** growth
        assert 0.9 * after < foreseen < 1.25 * after


ROUND_FINGERS = {
    "ball": {"shape": "sphere", "radius_mm": 5.0},
    "punch": {"shape": "flat", "diameter_mm": 8.0, "edge_radius_mm": 1.0},
}


@pytest.mark.parametrize(("x_mm", "z_mm"), [(0.0, 0.0), (64.0, 0.0), (0.5, 0.0), (32.0, 19.9)])
@pytest.mark.parametrize("finger", ROUND_FINGERS)
def test_a_round_finger_over_a_side_or_an_end_is_pressed_as_a_solid(
    finger: str, x_mm: float, z_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    def roughly(meshes: Any, *_given: Any, **_more: Any) -> Any:
        asked = meshes.asked
        solved = solve_solid(asked.scene, asked.x_m, asked.depth_m, asked.pressures_pa, 4e-3)
        return Refined(solved, np.array([1.0, 0.0]))

    monkeypatch.setattr(table, "refine", roughly)
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    tissue = scene.tissue.model_copy(update={"z_mm": -z_mm})  # as of a section, and of no file
    scene = scene.model_copy(update={"indenter": ROUND_FINGERS[finger], "tissue": tissue})
    assert press(scene, x_mm, 1.0, accuracy_pct=50).model == "solid"
    with pytest.raises(SceneError, match=r"model = 'axisymmetric': 0.* mm from a side or an end"):
        press(scene, x_mm, 1.0, model="axisymmetric")


def test_an_incompressible_round_block_is_pressed_by_elements_that_do_not_lock() -> None:
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    assert best_element(scene) == "T6"
    assert best_element(changed(scene, tissue={"poisson": 0.499})) == "Q4M"


def test_a_round_finger_further_inside_stays_a_body_of_revolution() -> None:
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    pressed = press(scene, 6.0, 0.2, accuracy_pct=20)
    assert pressed.model == "axisymmetric"
    left, right = pressed.states[0].contact_mm
    assert left + right == pytest.approx(12.0)  # it touches about x, as in other models
    assert right - left == pytest.approx(2 * np.sqrt(5.0 * 0.2), rel=0.15)  # Hertz: a^2 = R d
