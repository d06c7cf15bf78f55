"""Answers known on paper: Lamé's tube, Hertz's line contact, Cook's membrane."""

import numpy as np
import pytest

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


def tube(shop, element, plane, poisson, wall_m, n):
    """Largest error of displacement over all nodes, relative to Lamé's at the lumen."""
    outer, p = INNER_M + wall_m, 0.1

    def ring(points):
        r, angle = INNER_M + wall_m * points[:, 0], np.pi / 2 * points[:, 1]
        return np.column_stack([r * np.cos(angle), r * np.sin(angle)])

    through, around = n
    mesh = shop.grid(through, around, ring, pressed="left")
    body = shop.body(mesh, element, modulus_pa=MODULUS_PA, poisson=poisson, plane=plane)
    flat = 2 * np.flatnonzero(np.abs(body.nodes[:, 1]) < 1e-12) + 1
    upright = 2 * np.flatnonzero(np.abs(body.nodes[:, 0]) < 1e-12)
    fixed = np.concatenate([flat, upright])
    u = body.solve(fixed, np.zeros_like(body.nodes), np.zeros(body.section.size), p)
    r = np.hypot(*body.nodes.T)
    outward = (u * body.nodes).sum(axis=1) / r
    wanted = lame(r, INNER_M, outer, p, poisson, plane)
    return np.abs(outward - wanted).max() / lame(INNER_M, INNER_M, outer, p, poisson, plane)


@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_lame_tube_converges(shop, element, plane):
    coarse = tube(shop, element, plane, 0.3, 0.63e-3, (1, 6))
    fine = tube(shop, element, plane, 0.3, 0.63e-3, (2, 12))
    assert np.log2(coarse / fine) > 1.7
    assert fine < (0.002 if element in ("T6", "T6M", "Q8R") else 0.02)


@pytest.mark.parametrize("wall_mm", [0.63, 0.1, 0.05])
@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("element", ["T6", "Q8R"])
def test_one_quadratic_element_through_a_thin_wall(shop, element, plane, wall_mm):
    """Elements near-isotropic at 0.63 mm, then 6 and 12 times longer than thick."""
    assert tube(shop, element, plane, 0.49, 1e-3 * wall_mm, (1, 12)) < 0.005


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


def cook(shop, element, poisson, n):
    """Rise of the upper corner of Cook's membrane in plane strain, small strain, E 250, load 100.

    Converged: 7.77 at nu 0.4999 (Kasper and Taylor 2000)."""

    def shape(p):
        x = 48 * p[:, 0]
        low, high = 44 * p[:, 0], 44 + 16 * p[:, 0]
        return np.column_stack([x, low + p[:, 1] * (high - low)])

    body = shop.body(shop.grid(n, n, shape), element, modulus_pa=250.0, poisson=poisson)
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
    fixed = shop.dofs(np.flatnonzero(np.abs(body.nodes[:, 0]) < 1e-9))
    u = body.solve(fixed, np.zeros_like(body.nodes), load)
    return u[edge[-1], 1] / small


# how close n = 8 comes, and that it does for every Poisson's ratio
WITHIN = {"T6": 0.025, "T6M": 0.02, "Q4R": 0.03, "Q4M": 0.04, "Q8R": 0.012}


@pytest.mark.parametrize("element", WITHIN)
def test_cooks_membrane(shop, element):
    assert cook(shop, element, 0.4999, 8) == pytest.approx(7.77, rel=WITHIN[element])


@pytest.mark.parametrize("element", WITHIN)
def test_no_locking_over_the_whole_range(shop, element):
    """The error stays as nu goes to a half; Q8R on its finer mesh is the judge."""
    for poisson in (0.3, 0.45, 0.49, 0.499, 0.4999, 0.49999):
        truth = cook(shop, "Q8R", poisson, 12)
        assert cook(shop, element, poisson, 6) == pytest.approx(truth, rel=0.06), poisson
