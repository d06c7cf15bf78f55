"""Answers known on paper: Lamé's tube, an inflated one, Hertz's line contact, Cook's membrane."""

import bodies
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

from sim_backend.fem.elements import ELEMENTS
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.scene.scene_file import scene_from_text

MODULUS_PA = 400e3
INNER_M = 2.25e-3


def lame(r, a, b, p, poisson, plane):
    """Outward displacement [m] of a tube under pressure (Timoshenko and Goodier 1970, art. 28)."""
    scale = p * a**2 / (MODULUS_PA * (b**2 - a**2))
    if plane == "stress":
        return scale * ((1 - poisson) * r + (1 + poisson) * b**2 / r)
    return scale * (1 + poisson) * ((1 - 2 * poisson) * r + b**2 / r)


def quarter(element, plane, poisson, wall_m, n):
    """Of a tube, ``n`` elements through its wall and around; and what its symmetry fixes."""

    def ring(points):
        r, angle = INNER_M + wall_m * points[:, 0], np.pi / 2 * points[:, 1]
        return np.column_stack([r * np.cos(angle), r * np.sin(angle)])

    mesh = bodies.grid(*n, ring, pressed="left")
    body = bodies.body(mesh, element, modulus_pa=MODULUS_PA, poisson=poisson, plane=plane)
    flat = 2 * np.flatnonzero(np.abs(body.nodes[:, 1]) < 1e-12) + 1
    upright = 2 * np.flatnonzero(np.abs(body.nodes[:, 0]) < 1e-12)
    return body, np.concatenate([flat, upright])


def tube(element, plane, poisson, wall_m, n):
    """Largest error of displacement over all nodes, relative to Lamé's at the lumen."""
    outer, p = INNER_M + wall_m, 0.1
    body, fixed = quarter(element, plane, poisson, wall_m, n)
    u = body.solve(fixed, np.zeros_like(body.nodes), np.zeros(body.section.size), p)
    r = np.hypot(*body.nodes.T)
    outward = (u * body.nodes).sum(axis=1) / r
    wanted = lame(r, INNER_M, outer, p, poisson, plane)
    return np.abs(outward - wanted).max() / lame(INNER_M, INNER_M, outer, p, poisson, plane)


@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_lame_tube_converges(element, plane):
    coarse = tube(element, plane, 0.3, 0.63e-3, (1, 6))
    fine = tube(element, plane, 0.3, 0.63e-3, (2, 12))
    assert np.log2(coarse / fine) > 1.7
    assert fine < (0.002 if element in ("T6", "T6M", "Q8R") else 0.02)


@pytest.mark.parametrize("wall_mm", [0.63, 0.1, 0.05])
@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("element", ["T6", "Q8R"])
def test_one_quadratic_element_through_a_thin_wall(element, plane, wall_mm):
    """Elements near-isotropic at 0.63 mm, then 6 and 12 times longer than thick."""
    assert tube(element, plane, 0.49, 1e-3 * wall_mm, (1, 12)) < 0.005


def touched(plane, depth_mm, size_mm):
    """Half contact width [m] from the second moment of the contact forces, and the force [N/m].

    Hertz's pressure is half an ellipse: its second moment is F b^2 / 4.
    """
    scene = scene_from_text(
        f"""name = "half plane"
        plane = "{plane}"
        tissue = {{width_mm = 80.0, height_mm = 40.0, modulus_kpa = 50.0, poisson = 0.3}}
        indenter = {{shape = "cylinder", radius_mm = 10.0}}""",
        "test",
    )
    section, (solved,) = solve_finite(scene, 0.040, 1e-3 * depth_mm, [0.0], 1e-3 * size_mm)
    x = section.mesh.nodes[section.mesh.surface, 0] - 0.040
    moment = float((solved.multiplier[0] * x**2).sum())
    return 2 * np.sqrt(moment / solved.force_n_per_m), solved.force_n_per_m


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_hertz_line_contact(plane):
    """b^2 = 4 F R / (pi E*) (Johnson 1985, eq. 4.43), the better the smaller b / R is."""
    stiff = 50e3 if plane == "stress" else 50e3 / (1 - 0.3**2)
    errors = []
    for depth_mm, size_mm in ((0.05, 0.1), (0.0125, 0.05)):  # b / R = 4 % and 2 %
        half, force = touched(plane, depth_mm, size_mm)
        errors.append(abs(half / np.sqrt(4 * force * 10e-3 / (np.pi * stiff)) - 1))
    assert errors[1] < 0.6 * errors[0]
    assert errors[1] < 0.004


def cook(element, poisson, n):
    """Rise of the upper corner of Cook's membrane in plane strain, small strain, E 250, load 100.

    Converged: 7.77 at nu 0.4999 (Kasper and Taylor 2000)."""

    def shape(p):
        x = 48 * p[:, 0]
        low, high = 44 * p[:, 0], 44 + 16 * p[:, 0]
        return np.column_stack([x, low + p[:, 1] * (high - low)])

    body = bodies.body(bodies.grid(n, n, shape), element, modulus_pa=250.0, poisson=poisson)
    edge = np.flatnonzero(np.abs(body.nodes[:, 0] - 48) < 1e-9)
    edge = edge[np.argsort(body.nodes[edge, 1])]
    share = np.full(len(edge), 1.0)
    share[[0, -1]] = 0.5
    if element in ("T6", "T6M", "Q8R"):
        share = np.where(np.arange(len(edge)) % 2, 4.0, 2.0)
        share[[0, -1]] = 1.0
    small = 1e-4
    load = np.zeros(body.section.size)
    load[2 * edge + 1] = small * 100 * share / share.sum()
    fixed = bodies.dofs(np.flatnonzero(np.abs(body.nodes[:, 0]) < 1e-9))
    u = body.solve(fixed, np.zeros_like(body.nodes), load)
    return u[edge[-1], 1] / small


# how close n = 8 comes, and that it does for every Poisson's ratio
WITHIN = {"T6": 0.025, "T6M": 0.02, "Q4R": 0.03, "Q4M": 0.04, "Q8R": 0.012}


@pytest.mark.parametrize("element", WITHIN)
def test_cooks_membrane(element):
    assert cook(element, 0.4999, 8) == pytest.approx(7.77, rel=WITHIN[element])


@pytest.mark.parametrize("element", WITHIN)
def test_no_locking_over_the_whole_range(element):
    """The error stays as nu goes to a half; Q8R on its finer mesh is the judge."""
    for poisson in (0.3, 0.45, 0.49, 0.499, 0.4999, 0.49999):
        truth = cook("Q8R", poisson, 12)
        assert cook(element, poisson, 6) == pytest.approx(truth, rel=0.06), poisson


OUTER_M, POISSON, PRESSURE_PA = 2.88e-3, 0.49, 16e3
SHEAR, BULK = MODULUS_PA / (2 * (1 + POISSON)), MODULUS_PA / (3 * (1 - 2 * POISSON))


def nominal(stretches: np.ndarray) -> np.ndarray:
    """Principal nominal stresses (3,) [Pa] of principal ``stretches`` (3,)."""
    volume = stretches.prod()
    shape = SHEAR * volume ** (-2 / 3) * (stretches - (stretches**2).sum() / (3 * stretches))
    return np.asarray(shape + BULK * (volume - 1) * volume / stretches)


def stretches(along: float, radial_pa: float, plane: str, near: np.ndarray) -> np.ndarray:
    """All three, where the one ``along`` the ring and the radial nominal stress are known."""
    if plane == "strain":
        one = root(lambda l: nominal(np.array([l[0], along, 1.0]))[:1] - radial_pa, near[:1])
        return np.array([one.x[0], along, 1.0])
    both = root(
        lambda l: nominal(np.array([l[0], along, l[1]]))[[0, 2]] - [radial_pa, 0.0], near[[0, 2]]
    )
    return np.array([both.x[0], along, both.x[1]])


def by_shooting(plane: str) -> tuple[float, float]:
    """Inner and outer radius [m] under the pressure, which acts on the section as it thins:
    d P1 / dR = (P2 - P1) / R, dr / dR = l1 (Ogden 1984, sec. 5.2.4, P nominal)."""

    def outward(inner_m: float) -> np.ndarray:
        """(r, P1) on the outside, for an inner radius."""
        along, now = inner_m / INNER_M, np.ones(3)
        radial_pa = -PRESSURE_PA * along
        for _ in range(20):  # the thickness at the wall and the load on it
            now = stretches(along, radial_pa, plane, now)
            radial_pa = -PRESSURE_PA * along * now[2]

        def slope(r: float, state: np.ndarray) -> np.ndarray:
            here = stretches(state[0] / r, state[1], plane, now)
            return np.array([here[0], (nominal(here)[1] - state[1]) / r])

        wall = (INNER_M, OUTER_M)
        return solve_ivp(slope, wall, [inner_m, radial_pa], rtol=1e-7, atol=1e-9).y[:, -1]

    inner_m = brentq(lambda r: outward(r)[1], INNER_M, 1.4 * INNER_M, xtol=1e-9)
    return inner_m, float(outward(inner_m)[0])


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_the_wall_goes_where_the_equation_says(plane):
    """On the undeformed area the wall of plane stress would go out by 12 % more."""
    body, fixed = quarter("T6", plane, POISSON, OUTER_M - INNER_M, (2, 10))
    u = np.zeros_like(body.nodes)
    for share in (0.4, 0.7, 1.0):
        u = body.solve(fixed, u, np.zeros(body.section.size), share * PRESSURE_PA)
    r = np.hypot(*body.nodes.T)
    moved = np.hypot(*(body.nodes + u).T) - r
    for at_m, wanted_m in zip((INNER_M, OUTER_M), by_shooting(plane), strict=True):
        found_m = moved[np.abs(r - at_m) < 1e-9]
        np.testing.assert_allclose(found_m, wanted_m - at_m, rtol=2e-3)
