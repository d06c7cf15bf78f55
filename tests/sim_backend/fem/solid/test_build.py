"""Meshes of solids: volumes, lumps that are balls, lumens that hold pressure, the cut at z = 0."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_solid import small_solid, vessel

from sim_backend.fem import kernel
from sim_backend.fem.material_3d import von_mises
from sim_backend.fem.newton import CannotSolve, unloaded
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.build import build_body
from sim_backend.fem.solid.cut import Cut
from sim_backend.fem.solid.forces import forces, tangents, unit_pressure
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene, SceneError

ARTERY = {"kind": "artery", "x_mm": 16.0, "depth_mm": 9.0, "inner_diameter_mm": 4.5,
          "wall_mm": 0.63, "modulus_kpa": 400.0, "poisson": 0.45}  # fmt: skip
BALL = {"kind": "tumour", "x_mm": 16.0, "depth_mm": 9.0, "z_mm": 0.0, "diameter_mm": 5.0,
        "modulus_kpa": 1000.0, "poisson": 0.45}  # fmt: skip


def block(*inclusion: dict[str, Any], length_mm: float = 20.0) -> Scene:
    return small_solid(32.0, length_mm, *inclusion, height_mm=16.0, ball_mm=5.0)


def body_of(*inclusion: dict[str, Any]) -> SolidBody:
    return build_body(block(*inclusion), 16e-3, depth_m=1e-3, size_m=2e-3)


def volume_mm3(body: SolidBody, region: int) -> float:
    return 2e9 * float(body.wedges.weight[body.region == region].sum())  # a half is meshed


@pytest.mark.parametrize(("size_m", "off"), [(2e-3, 0.01), (1.3e-3, 0.002)])
def test_a_lump_is_a_ball(size_m: float, off: float) -> None:
    """Nodes between ball and tissue lie on the sphere; the missing volume falls faster than h^2."""
    body = build_body(block(BALL), 16e-3, depth_m=1e-3, size_m=size_m)
    assert volume_mm3(body, 1) == pytest.approx(np.pi / 6 * 125, rel=off)
    assert volume_mm3(body, 0) + volume_mm3(body, 1) == pytest.approx(32 * 16 * 20, rel=1e-5)
    inside, outside = (np.unique(body.wedges.cells[body.region == k]) for k in (1, 0))
    between = np.intersect1d(inside, outside)
    away = np.linalg.norm(1e3 * body.wedges.nodes[between] - [16, 7, 0], axis=1)
    np.testing.assert_allclose(away, 2.5, rtol=1e-6)


def test_a_stenosis_lies_in_its_stretch_only() -> None:
    ring = {"fraction": 0.3, "modulus_kpa": 4000.0, "z_mm": (-4.0, 4.0)}
    body = body_of({**ARTERY, "stenosis": ring})
    narrow = 2.25 * 0.7
    assert volume_mm3(body, 2) == pytest.approx(8 * np.pi * (2.25**2 - narrow**2), rel=0.01)


@pytest.mark.parametrize("first, second, named", [
    ({"x_mm": 11.0, "diameter_mm": 3.0}, {"x_mm": 14.005, "diameter_mm": 3.0},
     "inclusion[1].x_mm or depth_mm: 0.005 mm lie between inclusion[1] and inclusion[0]"),
    ({"x_mm": 8.0}, {"x_mm": 22.0, "depth_mm": 13.49}, "inclusion[1].depth_mm: "
     "0.01 mm lie between inclusion[1] and the bottom"),
    ({"x_mm": 8.0, "depth_mm": 2.51}, {"x_mm": 22.0}, "inclusion[0].depth_mm: "
     "0.01 mm lie between inclusion[0] and the surface"),
])  # fmt: skip
def test_what_leaves_no_room_for_elements_is_named(
    first: dict[str, float], second: dict[str, float], named: str
) -> None:
    with pytest.raises(SceneError, match=re.escape(named)):
        body_of({**BALL, **first}, {**BALL, **second})


def test_a_ball_at_an_end_is_named_by_its_z() -> None:
    with pytest.raises(SceneError, match=r"inclusion\[0\]\.z_mm: 0\.005 mm lie between .* an end"):
        build_body(block({**BALL, "z_mm": -7.495}), 16e-3, depth_m=1e-3, size_m=1.4e-3)


@pytest.mark.parametrize("end_mm", [1e-4, 9.9999])
def test_no_layer_is_as_thin_as_rounding_leaves_it(end_mm: float) -> None:
    ring = {"fraction": 0.3, "modulus_kpa": 4000.0, "z_mm": (-4.0, end_mm)}
    body = body_of({**ARTERY, "stenosis": ring})
    z = np.unique(body.wedges.nodes[:, 2].round(9))
    assert np.diff(z).min() > 0.01 * 2.88e-3
    assert z[[0, -1]] == pytest.approx([-10e-3, 10e-3])
    narrow = 2.25 * 0.7
    expected = (4 + end_mm) * np.pi * (2.25**2 - narrow**2)
    assert volume_mm3(body, 2) / 2 == pytest.approx(expected, rel=0.01)  # both halves are meshed


@pytest.mark.parametrize("stretch", [(-0.02, 0.02), (9.95, 12.0)])
def test_a_stretch_too_short_to_be_meshed_is_refused(stretch: tuple[float, float]) -> None:
    ring = {"fraction": 0.3, "modulus_kpa": 4000.0, "z_mm": stretch}
    with pytest.raises(ValueError, match=r"must be at least 0\.058 mm to be meshed"):
        block({**ARTERY, "stenosis": ring})


@pytest.mark.parametrize("stretch", [None, (-4.0, 4.0)])
def test_a_closed_stretch_of_lumen_is_in_balance(stretch: tuple[float, float] | None) -> None:
    """Pressure on all of it pushes nowhere across, and its ends' rings push inwards."""
    ring = {"fraction": 0.3, "modulus_kpa": 4000.0}
    body = body_of({**ARTERY, "stenosis": {**ring, "z_mm": stretch} if stretch else ring})
    total = np.zeros(3)
    for faces in body.lumens:
        force, _ = unit_pressure(faces, body.wedges.nodes)
        total += force.reshape(len(force), 3, -1).sum(axis=(0, 2))
    area = np.pi * (2.25**2 - (0.7 * 2.25) ** 2) * 1e-6
    np.testing.assert_allclose(total[:2], 0.0, atol=1e-3 * area)
    # of the half that is meshed, one end of the ring faces along z
    assert total[2] == pytest.approx(-area if stretch else 0.0, rel=0.01, abs=1e-3 * area)


def test_pressure_turns_with_the_wall() -> None:
    body = body_of(ARTERY)
    faces, nodes = body.lumens[0], body.wedges.nodes
    rng = np.random.default_rng(0)
    step = 1e-6 * rng.standard_normal(nodes.shape)
    (ahead, _), (behind, _) = (unit_pressure(faces, nodes + s * step) for s in (1, -1))
    _, stiffness = unit_pressure(faces, nodes)
    foreseen = np.einsum("sij,sj->si", stiffness, step.ravel()[faces.dofs])
    np.testing.assert_allclose((ahead - behind) / 2, foreseen, atol=1e-6 * np.abs(foreseen).max())


@pytest.mark.parametrize("built", sorted({False, kernel.BUILT}))
@pytest.mark.parametrize(("inclusion", "off"), [(ARTERY, 1e-10), (BALL, 0.01)])
def test_patch_and_tangent(
    inclusion: dict[str, Any], off: float, built: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Round a ball wedges are bent in space, where nine points integrate to 0.3 %."""
    monkeypatch.setattr(kernel, "BUILT", built)
    body = body_of(inclusion)
    wedges, even = body.wedges, np.full(len(body.shear), 1.0)
    rng = np.random.default_rng(0)
    stretch = 0.1 * rng.standard_normal((3, 3))
    u = wedges.nodes @ stretch.T
    force = forces(wedges, even, 10 * even, u)
    total = np.zeros((len(wedges.nodes), 3))
    np.add.at(total.ravel(), wedges.dofs, force)
    low, high = wedges.nodes.min(axis=0) + 1e-9, wedges.nodes.max(axis=0) - 1e-9
    inside = np.all((wedges.nodes > low) & (wedges.nodes < high), axis=1)
    for faces in body.lumens:
        inside[faces.nodes] = False
    assert np.abs(total[inside]).max() < off * np.abs(total).max()

    u = u + 1e-5 * rng.standard_normal(u.shape)
    step = 1e-8 * rng.standard_normal(u.shape)
    tangent = tangents(wedges, even, 10 * even, u)
    ahead, behind = (forces(wedges, even, 10 * even, u + s * step) for s in (1, -1))
    foreseen = np.einsum("mij,mj->mi", tangent, step.ravel()[wedges.dofs])
    np.testing.assert_allclose((ahead - behind) / 2, foreseen, atol=1e-5 * np.abs(foreseen).max())


def test_what_would_lock_is_refused() -> None:
    scene = block({**ARTERY, "poisson": 0.497})
    with pytest.raises(SceneError, match=r"inclusion 1: poisson = 0.497.*at most 0.495"):
        build_body(scene, 16e-3, depth_m=1e-3, size_m=2e-3)


def test_balls_behind_each_other_are_refused_by_what_a_section_cannot_hold() -> None:
    scene = block({**BALL, "z_mm": 6.0}, {**BALL, "x_mm": 18.0, "z_mm": -6.0})
    with pytest.raises(SceneError, match=r"behind each other, 2 mm apart .* more than 5 mm"):
        build_body(scene, 16e-3, depth_m=1e-3, size_m=2e-3)


def test_a_mesh_too_large_is_refused_before_it_is_solved() -> None:
    with pytest.raises(CannotSolve, match=r"make \d+ unknowns; at most 1000 .* thicker block"):
        build_body(block(), 16e-3, depth_m=1e-3, size_m=2e-3, most_unknowns=1000)
    with pytest.raises(CannotSolve, match="unknowns"):
        press(thin(0.5, 40.0), 20.0, 0.1, model="solid")


def thin(height_mm: float, width_mm: float) -> Scene:
    return small_solid(width_mm, width_mm - 4.0, height_mm=height_mm, poisson=0.49, ball_mm=5.0)


def test_a_thin_wide_block_is_pressed_as_the_axisymmetric_model_does() -> None:
    scene = thin(1.0, 24.0)
    solid, axisymmetric = (
        press(scene, 12.0, 0.2, model=model, accuracy_pct=5.0)
        for model in ("solid", "axisymmetric")
    )
    stated_pct = solid.force_error_estimate_pct + axisymmetric.force_error_estimate_pct
    assert solid.states[0].force_n == pytest.approx(
        axisymmetric.states[0].force_n, rel=0.01 * stated_pct
    )


@pytest.mark.parametrize("z_mm", [0.0, 1.5], ids=["half", "whole"])
def test_a_cut_shows_the_section_and_its_stress(z_mm: float) -> None:
    scene = small_solid(14.0, 12.0, vessel(7.0), z_mm=z_mm)
    body = build_body(scene, 7e-3, depth_m=0.5e-3, size_m=1.4e-3)
    cut = Cut(body)
    assert (body.wedges.nodes[cut.numbers, 2] == 0).all()
    a, b, c = np.moveaxis(cut.nodes_m[cut.triangles], 1, 0)
    first, second = b - a, c - a
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum() / 2
    assert 1e6 * area == pytest.approx(14.0 * 8.0 - np.pi, rel=2e-3)
    stretch = np.array([[0.05, 0.1, 0.0], [0.0, -0.15, 0.02], [0.03, 0.0, 0.04]])
    displacement = body.wedges.nodes @ stretch.T
    displacement[:, 0] += 80.0 * body.wedges.nodes[:, 2] ** 2  # no shear at z = 0, much beside it
    moved = replace(unloaded(body), displacement=displacement)
    assert cut.displacement_m(moved) == pytest.approx(cut.nodes_m @ stretch[:2, :2].T)
    stress = cut.von_mises_pa(moved)
    corner = np.argmin(np.hypot(*cut.nodes_m.T))
    assert stress[corner] == pytest.approx(
        float(von_mises(np.eye(3) + stretch, np.array(body.shear.min())))
    )
    stiffest = float(von_mises(np.eye(3) + stretch, np.array(body.shear.max())))
    assert stress.max() == pytest.approx(stiffest)
