"""Derivatives of solved presses, against the same presses solved again on the moved mesh."""

from collections.abc import Callable

import numpy as np
import pytest
from changed_scene import changed
from small_block import BLOCK

from sim_backend.fem import section as section_rules
from sim_backend.fem.axisymmetric import solve_axisymmetric
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import Grading
from sim_backend.fem.newton import Solution, as_solved, equilibrium
from sim_backend.fem.redrawn import followed
from sim_backend.fem.section import Section
from sim_backend.fem.sensitivity import LOADS, gradients, loaded, renumbered
from sim_backend.scene.inclusion import Tumour
from sim_backend.scene.numbers import numbers, with_number
from sim_backend.scene.scene_file import Scene, SceneError, load_scene
from sim_backend.scene.table import beyond_a_file
from sim_backend.scene.waves import PA_PER_MMHG

X_M, SIZE_M = 0.030, 1.2e-3
NO_EFFECT = ("indenter.length_mm",)
"""The force is per length of the finger."""


def two_lumps() -> Scene:
    lump = load_scene("TIT").inclusion[0].model_dump()
    beside = lump | {"x_mm": 38.0, "depth_mm": 9.0, "diameter_mm": 3.0}
    return changed("TIT", inclusion=[lump | {"x_mm": 30.0}, beside])


SCENES: dict[str, tuple[Scene, float, float]] = {
    "lump": (load_scene("TIT"), 2e-3, 0.0),
    "artery": (load_scene("TIHA"), 1.5e-3, 100.0),
    "stenosis": (load_scene("TISA"), 2e-3, 100.0),
    "plane strain": (changed("TIHA", plane="strain"), 1e-3, 80.0),
    "nearly incompressible": (
        changed("TIT", plane="strain", tissue={"poisson": 0.499}), 1e-3, 0.0,
    ),
    "lone vessel": (changed("HAOT", support={"contact": "frictionless"}), 1.5e-3, 80.0),
    "flat finger": (
        changed("TIT", indenter={"shape": "flat", "width_mm": 6.0, "edge_radius_mm": 1.0}),
        1e-3, 0.0,
    ),
    "wedge": (
        changed("TIT", indenter={"shape": "wedge", "angle_deg": 130.0, "tip_radius_mm": 1.0,
                                 "width_mm": 10.0}),
        1.5e-3, 0.0,
    ),
    "skin": (
        changed("TIHA", indenter={"skin": {"thickness_mm": 0.5, "modulus_kpa": 100.0}}),
        1.5e-3, 80.0,
    ),
    "two lumps": (two_lumps(), 1.5e-3, 0.0),
    "lifting block": (changed("TI", support={"lifts": True}), 1.5e-3, 0.0),
}  # fmt: skip


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Section, Solution]]:
    """Presses solved until rounding, which differences of forces need."""
    monkeypatch.setattr(section_rules, "TOLERANCE", 1e-12)
    monkeypatch.setattr(section_rules, "CLOSED_M", 1e-15)

    def solve(
        scene: Scene, depth_m: float, mmhg: float, x_m: float, size_m: float = SIZE_M
    ) -> tuple[Section, Solution]:
        pressure_pa = mmhg * PA_PER_MMHG
        section, (found,) = solve_finite(scene, x_m, depth_m, [pressure_pa], size_m)
        return section, found

    return solve


def difference(section: Section, here: Solution, scene: Scene, key: str, steps: float) -> float:
    """Central difference of the force [N/m]; NaN where other nodes touch than here."""
    by = loaded if key in LOADS else renumbered
    moved, step, _ = by(as_solved(section, here), here.load, key, scene)
    forces = []
    for sign in (1, -1):
        other, load = moved(sign * steps * step)
        found = equilibrium(other, here, load)
        if any(
            np.any((a > 0) != (b > 0))
            for a, b in zip(found.multiplier, here.multiplier, strict=True)
        ):
            return np.nan
        forces.append(found.force_n_per_m)
    return (forces[0] - forces[1]) / (2 * steps * step)


@pytest.mark.parametrize("name", SCENES)
def test_derivatives_are_those_of_presses_solved_again(
    name: str, solved: Callable[..., tuple[Section, Solution]]
) -> None:
    scene, depth_m, mmhg = SCENES[name]
    section, here = solved(scene, depth_m, mmhg, X_M if scene.tissue else 0.031)
    found = gradients(section, here, scene)
    assert set(found) == {*LOADS, *numbers(scene)}
    for key, slope in found.items():
        if key in NO_EFFECT or (key == "pressure_mmhg" and not section.lumens):
            assert slope == 0
            continue
        # one that all but cancels is judged by what a change of a hundredth would do to the force
        value = {"x_mm": 1.0, "depth_mm": 1.0, "pressure_mmhg": 100.0}.get(key)
        size = abs(numbers(scene)[key]) if value is None else value
        small = 1e-3 * here.force_n_per_m / size
        errors = [
            abs(difference(section, here, scene, key, steps) - slope) / max(abs(slope), small)
            for steps in (0.3, 1, 3, 10)
        ]
        assert np.nanmin(errors) < 1e-5, f"{key}: {slope:.6g}, off by {errors}"


def test_a_closed_lumen_s_derivatives(solved: Callable[..., tuple[Section, Solution]]) -> None:
    scene = changed(BLOCK, inclusion={"wall_mm": 0.5, "modulus_kpa": 40.0, "depth_mm": 3.5})
    section, here = solved(scene, 3.0e-3, 0.0, 0.012, 0.8e-3)
    assert as_solved(section, here).self_contact
    assert (here.multiplier[2] > 0).any()
    keys = ("depth_mm", "pressure_mmhg", "tissue.modulus_kpa", "inclusion.0.depth_mm",
            "inclusion.0.wall_mm")  # fmt: skip
    for key, slope in gradients(section, here, scene, keys).items():
        again = difference(section, here, scene, key, 3)
        assert slope == pytest.approx(again, rel=1e-5), key


def test_a_pulse_s_derivative_is_that_of_both_its_forces() -> None:
    scene = load_scene("TIHA")
    levels = [PA_PER_MMHG * p for p in (99.0, 100.0, 101.0)]
    section, (low, here, high) = solve_finite(scene, X_M, 1.5e-3, levels, SIZE_M)
    (slope,) = gradients(section, here, scene, ["pressure_mmhg"]).values()
    assert slope == pytest.approx((high.force_n_per_m - low.force_n_per_m) / 2, rel=1e-4)


def test_nodes_follow_circles_and_the_block() -> None:
    scene = two_lumps()
    section, _ = solve_finite(scene, X_M, 1e-3, [0.0], SIZE_M)
    nodes = section.mesh.nodes
    assert followed(nodes, scene, scene) is nodes
    wider = with_number(scene, "inclusion.0.diameter_mm", scene.inclusion[0].outer_radius_mm * 2.2)
    moved = followed(nodes, scene, wider)
    one = scene.inclusion[0]
    centre = 1e-3 * np.array([one.x_mm, scene.surface_mm - one.depth_mm])
    before, after = (np.hypot(*(at - centre).T) for at in (nodes, moved))
    on = np.abs(before - 1e-3 * one.outer_radius_mm) < 1e-9
    np.testing.assert_allclose(after[on], 1.1e-3 * one.outer_radius_mm, rtol=1e-9)
    for edge in (section.mesh.surface, section.mesh.bottom):
        np.testing.assert_allclose(moved[edge], nodes[edge], atol=1e-12)
    higher = with_number(scene, "tissue.height_mm", scene.surface_mm + 1.0)
    lifted = followed(nodes, scene, higher)
    np.testing.assert_allclose(lifted[section.mesh.surface, 1], 1e-3 * higher.surface_mm)
    np.testing.assert_allclose(lifted[section.mesh.bottom, 1], 0.0, atol=1e-12)


def test_what_sticks_has_no_gradient_of_its_own() -> None:
    scene = load_scene("HAOT")
    section, (here,) = solve_finite(scene, 0.031, 1.5e-3, [80 * PA_PER_MMHG], SIZE_M)
    with pytest.raises(SceneError, match="frictionless"):
        gradients(section, here, scene)


def test_an_unknown_number_is_refused() -> None:
    scene = load_scene("TI")
    section, (here,) = solve_finite(scene, X_M, 1e-3, [0.0], 2e-3)
    with pytest.raises(KeyError, match="wall_mm"):
        gradients(section, here, scene, ["wall_mm"])


def test_a_body_of_revolution_s_derivatives_obey_the_laws_of_scale() -> None:
    raw = load_scene("TI-solid").model_dump()
    lump = {"kind": "tumour", "x_mm": 0.0, "depth_mm": 7.0, "diameter_mm": 5.0,
            "modulus_kpa": 400.0, "poisson": 0.45}  # fmt: skip
    tissue = {"width_mm": 40.0, "length_mm": 40.0, "height_mm": 14.0, "modulus_kpa": 50.0,
              "poisson": 0.45}  # fmt: skip
    ball = {"shape": "sphere", "radius_mm": 5.0}
    scene = Scene.model_validate(raw | {"tissue": tissue, "indenter": ball, "inclusion": []})
    turned = beyond_a_file(scene, {"inclusion": (Tumour.model_validate(lump),)})
    grading = Grading(0.4e-3, lambda radius: 0.3 * radius, 0.4, 3e-3)
    section, (here,) = solve_axisymmetric(turned, 40e-3, 1.0e-3, grading)
    keys = [key for key in numbers(turned) if key not in ("tissue.length_mm", "inclusion.0.x_mm")]
    found = gradients(section, here, turned, ["depth_mm", *keys])
    values = {**numbers(turned), "depth_mm": 1.0}
    change = {key: values[key] * by for key, by in found.items()}
    assert sum(v for k, v in change.items() if k.endswith("_kpa")) == pytest.approx(
        here.force, rel=1e-6
    )
    lengths = sum(v for k, v in change.items() if k.endswith("_mm"))
    assert lengths == pytest.approx(2 * here.force, rel=1e-5)
