"""A ring under inner pressure at finite strain, against the ordinary differential equation of its
radius: d P1 / dR = (P2 - P1) / R, dr / dR = l1 (Ogden 1984, sec. 5.2.4, P nominal)."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

INNER_M, OUTER_M, MODULUS_PA, POISSON, PRESSURE_PA = 2.25e-3, 2.88e-3, 400e3, 0.49, 16e3
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
    """Inner and outer radius [m] under the pressure, which acts on the section as it thins."""

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
def test_the_wall_goes_where_the_equation_says(shop, plane):
    """In plane stress the wall thins and with it the area that the pressure acts on: on the
    undeformed one it would go out by 12 % more."""

    def ring(points):
        r, angle = INNER_M + (OUTER_M - INNER_M) * points[:, 0], np.pi / 2 * points[:, 1]
        return np.column_stack([r * np.cos(angle), r * np.sin(angle)])

    mesh = shop.grid(2, 10, ring, pressed="left")
    body = shop.body(mesh, "T6", modulus_pa=MODULUS_PA, poisson=POISSON, plane=plane)
    flat = 2 * np.flatnonzero(np.abs(body.nodes[:, 1]) < 1e-12) + 1
    upright = 2 * np.flatnonzero(np.abs(body.nodes[:, 0]) < 1e-12)
    fixed, u = np.concatenate([flat, upright]), np.zeros_like(body.nodes)
    for share in (0.4, 0.7, 1.0):
        u = body.solve(fixed, u, np.zeros(body.section.size), share * PRESSURE_PA)
    r = np.hypot(*body.nodes.T)
    moved = np.hypot(*(body.nodes + u).T) - r
    for at_m, wanted_m in zip((INNER_M, OUTER_M), by_shooting(plane), strict=True):
        found_m = moved[np.abs(r - at_m) < 1e-9]
        np.testing.assert_allclose(found_m, wanted_m - at_m, rtol=2e-3)
