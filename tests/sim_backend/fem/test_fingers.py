"""Fingers with a skin, and bonded fingers."""

from typing import Any

import numpy as np
import pytest
from changed_scene import changed
from small_block import BLOCK

from sim_backend.fem.continuation import continuation
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import build_section, half_contact
from sim_backend.fem.newton import CannotSolve, Load, unloaded
from sim_backend.fem.sensitivity import slopes
from sim_backend.fem.small_strain import solve_small
from sim_backend.models.press import press
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.waves import PA_PER_MMHG

DEPTH_M = 1.2e-3


def finger(**indenter: Any) -> Scene:
    """The small block under another finger."""
    return changed(BLOCK, indenter=indenter)


def block(modulus_kpa: float = 50.0, poisson: float = 0.49, **indenter: Any) -> Scene:
    """A bare block in plane strain."""
    return Scene.model_validate({
        "name": "block", "plane": "strain", "indenter": indenter,
        "tissue": {"width_mm": 40.0, "height_mm": 12.0, "modulus_kpa": modulus_kpa,
                   "poisson": poisson},
    })  # fmt: skip


def force(scene: Scene, depth_m: float = DEPTH_M, size_m: float = 0.6e-3) -> float:
    x_m = 0.5e-3 * scene.tissue.width_mm if scene.tissue else 0.0
    return solve_finite(scene, x_m, depth_m, [0.0], size_m)[1][0].force_n_per_m


@pytest.mark.parametrize("element", ["T6", "Q4", "Q8R"])
def test_a_skin_on_rigid_ground_is_an_elastic_foundation(element: str) -> None:
    """F = 4 a d M / (3 t) with a = sqrt(2 R d), M the confined modulus (Johnson 1985, eq. 4.58)."""
    skin = {"thickness_mm": 1.0, "modulus_kpa": 20.0, "poisson": 0.3}
    scene = block(1e6, shape="cylinder", radius_mm=8.0, skin=skin)
    depth_m, confined_pa = 0.05e-3, 20e3 * 0.7 / (1.3 * 0.4)
    _, (solved,) = solve_finite(scene, 0.020, depth_m, [0.0], 0.2e-3, element)
    half_m = np.sqrt(2 * 8e-3 * depth_m)
    wanted = 4 * half_m * depth_m * confined_pa / (3 * 1e-3)
    assert solved.force_n_per_m == pytest.approx(wanted, rel=0.01)


def test_a_hard_skin_is_none_and_a_softer_one_spares_the_tissue() -> None:
    bare = force(finger())
    skins = [force(finger(skin={"thickness_mm": 0.5, "modulus_kpa": e})) for e in (1e6, 200, 50)]
    assert skins[0] == pytest.approx(bare, rel=1e-4)
    assert bare > skins[1] > skins[2] > 0.5 * bare


def test_a_skin_feels_the_same_at_small_strain() -> None:
    scene = finger(skin={"thickness_mm": 0.5, "modulus_kpa": 50})
    _, (small,) = solve_small(scene, 0.012, 0.1e-3, [0.0], 0.5e-3)
    assert small.force_n_per_m == pytest.approx(force(scene, 0.1e-3, 0.5e-3), rel=0.02)


def test_a_skin_pressed_flat_is_refused_by_name() -> None:
    with pytest.raises(CannotSolve, match=r"skin is pressed by .* of its thickness") as refusal:
        press(finger(skin={"thickness_mm": 0.3, "modulus_kpa": 5}), 12.0, 2.0)
    assert refusal.value.limit == "skin"


def test_a_thick_or_incompressible_skin_is_no_skin() -> None:
    for skin in ({"thickness_mm": 1.2, "modulus_kpa": 50},
                 {"thickness_mm": 0.5, "modulus_kpa": 50, "poisson": 0.49}):  # fmt: skip
        with pytest.raises(ValueError, match="skin"):
            finger(skin=skin)


@pytest.mark.parametrize(
    "indenter", [{"bonded": True}, {"skin": {"thickness_mm": 0.5, "modulus_kpa": 50}}]
)
def test_the_slope_by_pressure_is_exact(indenter: dict[str, Any]) -> None:
    scene = finger(**indenter)
    section = build_section(scene, 0.012, depth_m=DEPTH_M, size_m=0.6e-3)
    p = 80 * PA_PER_MMHG
    loads = [Load(0.0, p), Load(0.5 * DEPTH_M, p), Load(DEPTH_M, p), Load(DEPTH_M, p + 20)]
    *_, there, further = continuation(section, unloaded(section), loads)
    slope = (further.force_n_per_m - there.force_n_per_m) / 20
    assert slopes(section, there)[1].force == pytest.approx(slope, rel=2e-3)


def test_what_a_bonded_finger_has_touched_keeps_its_place() -> None:
    scene = block(poisson=0.3, shape="cylinder", radius_mm=5.0, bonded=True)
    section = build_section(scene, 0.020, depth_m=DEPTH_M, size_m=0.6e-3)
    loads = [Load(d, 0.0) for d in (0.6e-3, DEPTH_M, 0.3e-3, 0.0, DEPTH_M)]
    first, deep, lifted, up, again = continuation(section, unloaded(section), loads)
    touched = first.multiplier[0] > 0
    x = section.mesh.surface[touched]
    for later in (deep, lifted, up, again):
        moved = later.displacement[x, 0] - first.displacement[x, 0]
        assert np.abs(moved).max() < 1e-8
    assert np.isfinite(deep.bonded_at_m[0]).sum() > touched.sum()
    assert up.force_n_per_m < 0, "it pulls at what it lifts"
    assert again.force_n_per_m == pytest.approx(deep.force_n_per_m, rel=1e-5)


@pytest.mark.parametrize("poisson", [0.1, 0.3, 0.49])
def test_bonding_takes_freedom_away_and_so_stiffens(poisson: float) -> None:
    flat = {"shape": "flat", "width_mm": 6.0, "edge_radius_mm": 0.5}
    free = force(block(poisson=poisson, **flat), 0.6e-3)
    fixed = force(block(poisson=poisson, bonded=True, **flat), 0.6e-3)
    assert 1.002 < fixed / free < 1.05


def test_a_bonded_finger_is_pressed_at_finite_strain() -> None:
    shallow = press(finger(bonded=True), 12.0, 0.05, accuracy_pct=5)
    assert shallow.model.startswith("finite")
    with pytest.raises(CannotSolve, match="bonded"):
        press(finger(bonded=True), 12.0, 0.05, model="small")


def test_a_bonded_finger_s_answer_is_its_path_s() -> None:
    flat = block(shape="flat", width_mm=6.2, edge_radius_mm=1.4, bonded=True)
    thin = changed(flat, tissue={"height_mm": 2.4, "width_mm": 24.0})
    place, size_m = (0.012, 0.33e-3), 0.56e-3
    section = build_section(thin, place[0], depth_m=place[1], size_m=size_m)
    short = [Load(place[1] * (k / 60) ** 2, 0.0) for k in range(1, 61)]
    *_, truth = continuation(section, unloaded(section), short)
    assert force(thin, place[1], size_m) == pytest.approx(truth.force_n_per_m, rel=0.01)
    (long,) = continuation(section, unloaded(section), [Load(place[1], 0.0)])
    assert long.force_n_per_m < 0.95 * truth.force_n_per_m
    coarser = solve_finite(thin, *place, [0.0], 2 * size_m)
    _, (nested,) = solve_finite(thin, *place, [0.0], size_m, coarser=coarser)
    assert nested.force_n_per_m == pytest.approx(truth.force_n_per_m, rel=0.01)
    station = respond(thin, place[0], place[1])
    felt = float(station.force_n(place[1], 0.0)) / station.length_m
    assert felt == pytest.approx(truth.force_n_per_m, rel=0.03)


@pytest.mark.parametrize("element", ["T6", "Q4", "Q8R"])
def test_a_node_s_share_of_the_surface_is_the_force_of_an_even_pressure(element: str) -> None:
    """The integral of its shape function: 1/6, 2/3 and 1/6 of a quadratic side, halves of a linear
    one; by Lagrange's polynomials here, element by element."""
    section = build_section(BLOCK, 12e-3, depth_m=1e-3, size_m=0.8e-3, element=element)
    x = section.mesh.nodes[section.mesh.surface, 0]
    order = 1 if element == "Q4" else 2
    wanted = np.zeros(len(x))
    for first in range(0, len(x) - order, order):
        side = x[first : first + order + 1]
        for k in range(order + 1):
            hat = np.poly1d(np.polyfit(side, np.eye(order + 1)[k], order)).integ()
            wanted[first + k] += hat(side[-1]) - hat(side[0])
    assert section.surface_share_m == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("indenter, depth_m", [
    ({"shape": "cylinder", "radius_mm": 5.0}, 0.1e-3),
    ({"shape": "cylinder", "radius_mm": 5.0}, 2.5e-3),
    ({"shape": "cylinder", "radius_mm": 1.0}, 2.0e-3),
    ({"shape": "flat", "width_mm": 4.0, "edge_radius_mm": 1.0}, 2.0e-3),
    ({"shape": "flat", "width_mm": 10.0, "edge_radius_mm": 0.5}, 2.5e-3),
])  # fmt: skip
def test_the_edge_of_the_contact_lies_where_elements_are_small(
    indenter: dict[str, Any], depth_m: float
) -> None:
    scene = changed(block(**indenter), tissue={"width_mm": 64.0, "height_mm": 16.83})
    section, (solved,) = solve_finite(scene, 0.020, depth_m, [0.0], 0.2e-3)
    touched = section.mesh.nodes[section.mesh.surface][solved.multiplier[0] > 0, 0]
    assert np.abs(touched - section.finger.x).max() < half_contact(section.finger, depth_m)


def test_a_flat_finger_s_pulse_does_not_hang_on_where_its_nodes_are() -> None:
    tiha = load_scene("TIHA").model_dump()
    flat = {"shape": "flat", "width_mm": 4.0, "edge_radius_mm": 1.0, "length_mm": 10.0}
    scene = Scene.model_validate(tiha | {"plane": "strain", "indenter": flat})
    for x_mm in (19.99, 20.0, 20.01):
        found = press(scene, x_mm, 2.0, (80.0, 120.0), accuracy_pct=1.5)
        # 15,500 to 24,900 unknowns, refined over all of the contact: 11.198 to 11.204 mN
        error_pct = 100 * abs(found.pulse_n / 11.20e-3 - 1)
        assert error_pct < min(found.pulse_error_estimate_pct, 1.5)


def test_a_blunt_wedge_carries_a_wedge_s_force() -> None:
    """P = E* a cot(alpha), E* in plane strain (Johnson 1985, eq. 5.13): a wide contact on a high
    block, its flanks at 10 degrees to the surface, so that strains are small."""
    tissue = {"width_mm": 200.0, "height_mm": 100.0, "modulus_kpa": 50.0, "poisson": 0.3}
    wedge = {"shape": "wedge", "angle_deg": 160.0, "tip_radius_mm": 0.3, "width_mm": 12.0}
    raw = {"name": "wedge", "plane": "strain", "tissue": tissue, "indenter": wedge}
    found = press(Scene.model_validate(raw), 100.0, 0.6, accuracy_pct=1)
    (state,) = found.states
    left, right = state.contact_mm
    stiffness_n_per_mm2 = 0.050 / (1 - 0.3**2)
    wanted = stiffness_n_per_mm2 * (right - left) / 2 / np.tan(np.radians(80))
    assert state.force_n_per_mm == pytest.approx(wanted, rel=0.04)
