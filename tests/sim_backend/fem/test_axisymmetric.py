"""Bodies of revolution against closed forms and the integral equation of a punch on a layer."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from small_solid import small_solid

from sim_backend.arrays import Array
from sim_backend.fem.axisymmetric import build_axisymmetric, solve_axisymmetric
from sim_backend.fem.continuation import continuation
from sim_backend.fem.internal import forces_and_tangents
from sim_backend.fem.model import Grading
from sim_backend.fem.newton import Load, unloaded
from sim_backend.fem.section import Section
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene

E_PA, R_M = 50e3, 5e-3
BALL = {"shape": "sphere", "radius_mm": 1e3 * R_M}
PUNCH = {"shape": "flat", "diameter_mm": 6.0, "edge_radius_mm": 0.02}
LUMP = {"kind": "tumour", "x_mm": 50.0, "depth_mm": 6.0, "diameter_mm": 5.0,
        "modulus_kpa": 1000.0, "poisson": 0.49}  # fmt: skip


def block(finger: dict[str, Any], poisson: float, height_mm: float, *lumps: Any) -> Scene:
    return small_solid(100.0, 100.0, *lumps, height_mm=height_mm, poisson=poisson, indenter=finger)


def grading(contact_m: float, coarsest_m: float = 8e-3) -> Grading:
    return Grading(contact_m, lambda radius: 0.3 * radius, 0.35, coarsest_m)


@pytest.mark.parametrize("poisson", [0.3, 0.45, 0.49, 0.4999])
def test_hertz(poisson: float) -> None:
    """Johnson 1985, eq. 4.23."""
    depth_m = 0.02e-3  # Hertz neglects that the surface also moves inwards: by the contact over R
    scene = block(BALL, poisson, 100.0)
    _, (solution,) = solve_axisymmetric(scene, 0.1, depth_m, grading(0.016e-3))
    hertz = 4 / 3 * E_PA / (1 - poisson**2) * np.sqrt(R_M) * depth_m**1.5
    assert solution.force_n_per_m == pytest.approx(hertz, rel=0.01)


def test_the_way_down_belongs_to_the_finger() -> None:
    def force_n(times: float) -> float:
        scene = small_solid(
            40.0 * times, 40.0 * times, height_mm=20.0 * times, poisson=0.49, ball_mm=5.0 * times
        )
        sizes = grading(0.3e-3 * times, 4e-3 * times)
        _, (found,) = solve_axisymmetric(scene, 20e-3 * times, 2e-3 * times, sizes)
        return found.force_n

    assert force_n(0.01) == pytest.approx(1e-4 * force_n(1.0), rel=5e-3)  # on a mesh of its own


def layer_kernel(poisson: float, bonded: bool) -> Any:
    """1 - L(u): what a rigid base at depth h takes off the half-space's answer to a wave number
    u / h (Vorovich, Aleksandrov and Babeshko 1974; bonded as in Hayes et al. 1972)."""

    def missing(u: float) -> float:
        if not bonded:
            return float(1 - 2 * np.sinh(u) ** 2 / (np.sinh(2 * u) + 2 * u)) if u > 1e-9 else 1.0
        k = 3 - 4 * poisson
        above = 2 * k * np.sinh(2 * u) - 4 * u
        return float(1 - above / (2 * k * np.cosh(2 * u) + 4 * u**2 + 1 + k**2))

    return missing


def layer_factor(ratio: float, poisson: float, *, bonded: bool, ball: bool) -> tuple[float, float]:
    """Force over 2 E* a d of a contact of radius a = ``ratio`` h, and d over a^2 / R for a ball.

    Hayes et al. 1972 reduce it to phi(x) - a/(pi h) int_-1^1 k(x - s) phi(s) ds = d - a^2 x^2 / R.
    """
    s, w = np.polynomial.legendre.leggauss(24)
    missing = layer_kernel(poisson, bonded)
    apart = np.abs(s[:, None] - s) * ratio
    distinct, back = np.unique(np.round(apart, 12), return_inverse=True)
    table = [quad(lambda u, y=y: missing(u) * np.cos(u * y), 0, 30, limit=200)[0] for y in distinct]
    kernel = ratio / np.pi * np.array(table)[back.ravel()].reshape(apart.shape)
    phi: Array = np.linalg.solve(np.eye(24) - kernel * w, np.column_stack([np.ones(24), s**2]))
    if not ball:
        return float(w @ phi[:, 0] / 2), 0.0
    ends = [np.polynomial.Polynomial.fit(s, column, 16)(1.0) for column in phi.T]
    depth = float(ends[1] / ends[0])  # no pressure at the contact's edge
    return float(w @ (depth * phi[:, 0] - phi[:, 1]) / 2) / depth, depth


def on_base(section: Section, bonded: bool) -> Section:
    bottom = section.mesh.bottom
    fixed = np.union1d(section.fixed, 2 * bottom) if bonded else section.fixed
    return replace(section, fixed=fixed)


@pytest.mark.parametrize("bonded", [False, True])
@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_a_flat_punch_on_a_layer(poisson: float, bonded: bool) -> None:
    """Hayes et al. 1972: a layer as thick as the punch is wide."""
    depth_m, radius_m = 5e-6, 3e-3
    scene = block(PUNCH, poisson, 6.0)
    section = on_base(build_axisymmetric(scene, 60e-3, depth_m, grading(0.01e-3, 2e-3)), bonded)
    (solution,) = continuation(section, unloaded(section), [Load(depth_m, 0.0)])
    factor, _ = layer_factor(0.5, poisson, bonded=bonded, ball=False)
    expected = 2 * E_PA / (1 - poisson**2) * radius_m * depth_m * factor
    assert solution.force_n_per_m == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("bonded", [False, True])
def test_a_ball_on_a_layer(bonded: bool) -> None:
    poisson, contact_m, height_m = 0.49, 0.9e-3, 4.5e-3
    factor, unit = layer_factor(contact_m / height_m, poisson, bonded=bonded, ball=True)
    depth_m = unit * contact_m**2 / R_M
    scene = block(BALL, poisson, 1e3 * height_m)
    section = on_base(build_axisymmetric(scene, 50e-3, depth_m, grading(0.04e-3, 1.5e-3)), bonded)
    loads = [Load(s * depth_m, 0.0) for s in (0.5, 1.0)]
    solution = list(continuation(section, unloaded(section), loads))[-1]
    expected = 2 * E_PA / (1 - poisson**2) * contact_m * depth_m * factor
    assert solution.force_n_per_m == pytest.approx(expected, rel=0.02)
    if bonded:
        assert expected == pytest.approx(dimitriadis_n(depth_m, height_m, poisson), rel=0.02)


def dimitriadis_n(depth_m: float, height_m: float, poisson: float) -> float:
    """Dimitriadis et al. 2002, eq. 12, a bonded layer."""
    chi = np.sqrt(R_M * depth_m) / height_m
    a = -(1.2876 - 1.4678 * poisson + 1.3442 * poisson**2) / (1 - poisson)
    b = (0.6387 - 1.0277 * poisson + 1.5164 * poisson**2) / (1 - poisson)
    terms = [1.0, -2 * a / np.pi, 4 * a**2 / np.pi**2,
             -8 / np.pi**3 * (a**3 + 4 * np.pi**2 / 15 * b),
             16 * a / np.pi**4 * (a**3 + 3 * np.pi**2 / 5 * b)]  # fmt: skip
    hertz = 4 / 3 * E_PA / (1 - poisson**2) * np.sqrt(R_M) * depth_m**1.5
    return float(hertz * np.polynomial.Polynomial(terms)(chi))


@pytest.mark.parametrize("poisson", [0.45, 0.499])
def test_tangent_by_differences(poisson: float) -> None:
    section = build_axisymmetric(block(BALL, poisson, 20.0), 30e-3, 1e-3, grading(2e-3))
    rng = np.random.default_rng(0)
    u = 1e-4 * rng.standard_normal(section.mesh.nodes.shape)
    step = 1e-8 * rng.standard_normal(u.shape)
    _, tangent = forces_and_tangents(section, u)
    ahead, behind = (forces_and_tangents(section, u + s * step)[0] for s in (1, -1))
    moved = step[section.cells.nodes].reshape(len(section.cells.nodes), -1)
    foreseen = np.einsum("mij,mj->mi", tangent, moved)
    np.testing.assert_allclose((ahead - behind) / 2, foreseen, atol=1e-5 * np.abs(foreseen).max())


def test_the_boxes_round_the_block_bound_its_force() -> None:
    """CalculiX, three dimensions, the same block (64 x 16.83 x 40 mm): 0.5770 N."""
    scene = small_solid(64.0, 40.0, height_mm=16.83, poisson=0.49, indenter=BALL)
    pressed = press(scene, 32.0, 2.0, model="axisymmetric")
    assert pressed.model == "axisymmetric"
    assert pressed.states[0].force_n == pytest.approx(0.5770, rel=0.01)
    off_pct = 100 * abs(pressed.states[0].force_n / 0.5770 - 1)
    assert off_pct < pressed.error_estimate_pct < 3.0
    assert np.isnan(pressed.states[0].force_n_per_mm)
    states = pressed.as_json()["states"]
    assert isinstance(states, list) and states[0]["force_n_per_mm"] is None


def test_a_hard_ball_below_is_felt_and_meshed_as_a_half_circle() -> None:
    plain, lump = (
        solve_axisymmetric(block(BALL, 0.49, 20.0, *more), 30e-3, 1e-3, grading(0.15e-3))
        for more in ((), (LUMP,))
    )
    section = lump[0]
    volume = section.cells.weight[section.mesh.region == 1].sum()
    assert volume == pytest.approx(np.pi / 6 * 5e-3**3, rel=2e-3)
    rise = lump[1][0].force_n_per_m / plain[1][0].force_n_per_m
    assert 1.05 < rise < 1.5


def test_a_finer_mesh_begins_where_the_coarser_one_ended() -> None:
    scene = block(BALL, 0.49, 20.0)
    fine = grading(0.42e-3)
    coarse = solve_axisymmetric(scene, 0.03, 1e-3, grading(0.6e-3))
    _, (anew,) = solve_axisymmetric(scene, 0.03, 1e-3, fine)
    _, (carried,) = solve_axisymmetric(scene, 0.03, 1e-3, fine, coarse)
    assert carried.force_n_per_m == pytest.approx(anew.force_n_per_m, rel=1e-6)
    assert not np.array_equal(carried.displacement, anew.displacement)  # it came another way


def test_a_blunt_cone_carries_a_cone_s_force() -> None:
    """P = 2 E* d^2 tan(alpha) / pi (Love 1939; Johnson 1985, eq. 5.11), its flanks at 10 degrees to
    the surface, so that strains are small."""
    cone = {"shape": "cone", "angle_deg": 160.0, "tip_radius_mm": 0.2, "diameter_mm": 12.0}
    scene = small_solid(360.0, 360.0, height_mm=180.0, poisson=0.3, indenter=cone)
    (state,) = press(scene, 180.0, 0.5, model="axisymmetric").states
    stiffness = 0.050 / (1 - 0.3**2)
    sharp_mm = 0.2 * (1 / np.sin(np.radians(80)) - 1)  # how much lower the point would be
    wanted = 2 * stiffness * (0.5 + sharp_mm) ** 2 * np.tan(np.radians(80)) / np.pi
    assert state.force_n == pytest.approx(wanted, rel=0.03)
