"""What is read under the finger: von Mises stress, and the forces on taxels."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_block import BLOCK
from small_solid import small_solid

from sim_backend.arrays import Array
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.material import plane_stress, von_mises
from sim_backend.fem.model import Grading, build_section
from sim_backend.fem.newton import Solution
from sim_backend.fem.section import Section
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.fem.stress import under_finger_pa
from sim_backend.fem.taxels import section_taxels_n, solid_taxels_n
from sim_backend.models.refine import Asked, refine
from sim_backend.models.round_press import refine_axisymmetric
from sim_backend.models.section_meshes import SectionMeshes, mesh_grading
from sim_backend.scene.scene_file import Scene, SceneError, load_scene
from sim_backend.scene.taxels import TaxelArray
from sim_backend.scene.waves import PA_PER_MMHG

LEVELS_PA = [80 * PA_PER_MMHG, 120 * PA_PER_MMHG]
EDGES_M = 1e-3 * np.arange(-5.0, 5.5)
ALL_ALONG_M = np.array([-1.0, 1.0])


def columns(section: Section, solution: Solution, edges_m: Array = EDGES_M) -> Array:
    """Force [N/m] on each."""
    return section_taxels_n(section, solution, edges_m, ALL_ALONG_M, 1.0)[0]


@pytest.mark.parametrize("depth_m", [0.5e-3, 1.0e-3, 3.0e-3])
def test_taxels_over_the_middle_of_a_vessel(depth_m: float) -> None:
    scene = load_scene("TIHA")
    meshes = SectionMeshes(Asked(scene, 0.032, depth_m, LEVELS_PA), "finite")
    section, solutions = refine(meshes, np.array([1.0, 1.0])).solved
    for solution in solutions:
        found = columns(section, solution)
        assert found.sum() == pytest.approx(solution.force, rel=1e-12)
        np.testing.assert_allclose(found, found[::-1], atol=1e-3 * found.max())
    low, high = (columns(section, one) for one in solutions)
    pulse = high - low
    np.testing.assert_allclose(pulse, pulse[::-1], atol=0.01 * pulse.max())


@pytest.mark.parametrize("depth_m", [0.5e-3, 2.0e-3])
def test_another_mesh_s_taxels_and_pulses_are_the_same(depth_m: float) -> None:
    scene = load_scene("TIHA")
    half_m = scene.indenter.profile.scale
    found = []
    for share in (0.35, 0.25, 0.2):
        grading = mesh_grading(scene, share * half_m, share)
        section, both = solve_finite(
            scene, 0.032, depth_m, LEVELS_PA, share * half_m, grading=grading
        )
        found.append([columns(section, one) for one in both])
    low, high = np.swapaxes(found, 0, 1)
    pulse = high - low
    for one, p in zip(low, pulse, strict=True):
        np.testing.assert_allclose(one, low[-1], atol=3e-3 * low.max())
        np.testing.assert_allclose(p, pulse[-1], atol=0.05 * np.abs(pulse).max())


@pytest.mark.parametrize("skin", [None, {"thickness_mm": 0.3, "modulus_kpa": 1e6}])
def test_taxels_under_a_cylinder_are_hertz_s(skin: dict[str, float] | None) -> None:
    """p = 2 P / (pi a^2) sqrt(a^2 - x^2), a^2 = 4 P R / (pi E*) (Johnson 1985, eqs. 4.43, 4.45); a
    hard skin changes nothing."""
    scene = Scene.model_validate({
        "name": "hertz", "plane": "strain", "indenter": {"radius_mm": 10.0, "skin": skin},
        "tissue": {"width_mm": 120.0, "height_mm": 60.0, "modulus_kpa": 50.0, "poisson": 0.3},
    })  # fmt: skip
    grading = Grading(0.06e-3, lambda radius: radius, 0.25, 8e-3)
    section, (solution,) = solve_finite(scene, 0.06, 0.3e-3, [0.0], 1e-3, grading=grading)
    force = solution.force
    half_m = np.sqrt(4 * force * 10e-3 / (np.pi * 50e3 / (1 - 0.3**2)))
    edges_m = np.linspace(-1.25, 1.25, 11) * half_m
    s = np.clip(edges_m / half_m, -1, 1)
    below = force * (0.5 + (s * np.sqrt(1 - s**2) + np.arcsin(s)) / np.pi)
    wanted = np.diff(below)
    found = columns(section, solution, edges_m)
    np.testing.assert_allclose(found, wanted, atol=0.03 * wanted.max())


def solid(**finger: Any) -> Scene:
    return small_solid(24.0, 24.0, height_mm=12.0, indenter=finger)


def test_taxels_of_a_solid_are_those_of_the_body_of_revolution() -> None:
    scene = solid(shape="sphere", radius_mm=4.0)
    edges_m = TaxelArray(4, 4, 2.0).edges_m(scene.indenter)
    body, (pressed,) = solve_solid(scene, 0.012, 1e-3, [0.0], 0.36 * 4e-3, judge=False)
    found = solid_taxels_n(body, pressed, *edges_m, 0.0)
    assert found.sum() == pytest.approx(pressed.force, rel=1e-12)
    np.testing.assert_allclose(found, found[::-1], rtol=1e-9)  # of which one half was solved
    section, (turned,) = refine_axisymmetric(Asked(scene, 0.012, 1e-3)).solved
    round_n = section_taxels_n(section, turned, *edges_m, 0.0)
    assert round_n.sum() == pytest.approx(turned.force, rel=1e-9)
    np.testing.assert_allclose(round_n, round_n.T, atol=1e-6 * round_n.max())
    scaled = round_n * pressed.force / turned.force
    np.testing.assert_allclose(found, scaled, atol=0.06 * scaled.max())


def test_rows_share_a_section_s_force_by_their_length() -> None:
    section, (solution,) = solve_finite(load_scene("TI"), 0.032, 1e-3, [0.0], 2e-3)
    whole = 0.01 * columns(section, solution)
    for rows, pitch_mm, parts in ((2, 2.0, [0.2, 0.2]), (4, 5.0, [0.0, 0.5, 0.5, 0.0])):
        across_m, along_m = TaxelArray(rows, 8, pitch_mm).edges_m(load_scene("TI").indenter)
        found = section_taxels_n(section, solution, across_m, along_m, 0.01)
        np.testing.assert_allclose(found.sum(axis=1) / whole.sum(), parts, atol=1e-9)


@settings(max_examples=40)
@given(st.integers(1, 9), st.integers(1, 9), st.one_of(st.none(), st.floats(0.1, 5)))
def test_an_array_s_middle_is_the_finger_s(rows: int, columns: int, pitch: float | None) -> None:
    across_m, along_m = TaxelArray(rows, columns, pitch).edges_m(load_scene("TI").indenter)
    assert (len(across_m), len(along_m)) == (columns + 1, rows + 1)
    for edges_m in (across_m, along_m):
        np.testing.assert_allclose(edges_m, -edges_m[::-1], atol=1e-12)
        np.testing.assert_allclose(np.diff(edges_m), edges_m[1] - edges_m[0])


@pytest.mark.parametrize("given, words", [
    ((0, 4), "from 1 x 1"), ((65, 64), "from 1 x 1"), ((1, 4, -1.0), "must be above 0"),
])  # fmt: skip
def test_an_array_that_cannot_be_is_refused(given: tuple[Any, ...], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        TaxelArray(*given)


@pytest.mark.parametrize("x_m", [1e-3, 7.3e-3])
def test_even_strain_is_read_as_it_is(x_m: float) -> None:
    section = build_section(BLOCK, x_m, depth_m=1e-3, size_m=0.5e-3)
    gradient = np.array([[0.06, 0.02], [-0.01, -0.09]])
    f = (gradient + np.eye(2)).reshape(4)
    shear, bulk = section.shear[0], section.bulk[0]
    surface = section.mesh.surface
    on_surface = np.isin(section.cells.nodes, surface).any(axis=1)
    assert (section.shear[on_surface] == shear).all()  # all of it tissue
    thickness = plane_stress(f, shear, bulk).thickness if section.plane_stress else np.array(1.0)
    expected = float(von_mises(f, thickness, shear))
    assert under_finger_pa(section, section.mesh.nodes @ gradient.T) == pytest.approx(expected)


def test_stress_is_read_under_the_finger_and_nowhere_else() -> None:
    """Of a stretch that grows along the surface, which quadratic elements hold exactly."""
    section = build_section(BLOCK, 7e-3, depth_m=1e-3, size_m=0.5e-3)
    nodes = section.mesh.nodes
    bent = np.column_stack([10.0 * (nodes[:, 0] - 7e-3) ** 2, np.zeros(len(nodes))])
    read = [
        under_finger_pa(replace(section, finger=replace(section.finger, x=x)), bent)
        for x in (7e-3, 8e-3, 9e-3)
    ]
    assert read[0] < 0.1 * read[1] < 0.07 * read[2]
