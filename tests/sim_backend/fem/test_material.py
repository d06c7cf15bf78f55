"""The neo-Hookean law, in the plane and in space: stress from energy, exact tangents, limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backend.fem import material_3d as space
from sim_backend.fem.material import (
    energy_density,
    moduli,
    plane_strain,
    plane_stress,
    thinning,
    von_mises,
)

entry = st.floats(-0.35, 0.35)
deformations = st.tuples(entry, entry, entry, entry).map(lambda e: np.array([1.0, 0, 0, 1.0]) + e)
poissons = st.sampled_from([0.0, 0.3, 0.45, 0.49, 0.499])
LAWS = {"stress": plane_stress, "strain": plane_strain}


def numbers(poisson):
    return (np.array(m) for m in moduli(50e3, poisson))


def slope(function, f, step=1e-6):
    """Central differences of ``function`` (4,) -> (...), the derivative on the last axis."""
    unit = step * np.eye(4)
    return np.stack([(function(f + e) - function(f - e)) / (2 * step) for e in unit], axis=-1)


@pytest.mark.parametrize("plane", LAWS)
@given(f=deformations, poisson=poissons)
def test_stress_is_the_slope_of_energy(plane, f, poisson):
    g, k = numbers(poisson)

    def energy(at):
        return energy_density(at, LAWS[plane](at, g, k).thickness, g, k)

    solid = LAWS[plane](f, g, k)
    np.testing.assert_allclose(solid.stress, slope(energy, f), atol=2e-7 * (g + k))


@pytest.mark.parametrize("plane", LAWS)
@given(f=deformations, poisson=poissons)
def test_tangent_is_the_slope_of_stress(plane, f, poisson):
    """In plane stress through the condensed thickness too."""
    g, k = numbers(poisson)
    law = LAWS[plane]
    solid = law(f, g, k)
    by_differences = slope(lambda at: law(at, g, k).stress, f)
    largest = np.abs(solid.tangent).max()
    np.testing.assert_allclose(solid.tangent, by_differences, atol=1e-6 * largest)
    np.testing.assert_allclose(solid.tangent, solid.tangent.T, atol=1e-9 * largest)


@given(f=deformations, poisson=poissons)
def test_thinning_is_the_slope_of_thickness(f, poisson):
    g, k = numbers(poisson)
    thickness, by_f = thinning(f, g, k)
    assert thickness == plane_stress(f, g, k).thickness
    by_differences = slope(lambda at: plane_stress(at, g, k).thickness, f)
    np.testing.assert_allclose(by_f, by_differences, atol=1e-6)


@given(f=deformations, poisson=poissons)
def test_nothing_pulls_across_a_plane_stress_section(f, poisson):
    g, k = numbers(poisson)
    l3 = plane_stress(f, g, k).thickness
    h = 1e-6
    ahead, behind = (energy_density(f, l3 + s, g, k) for s in (h, -h))
    here = energy_density(f, l3, g, k)
    assert ahead >= here - 1e-9 * g
    assert behind >= here - 1e-9 * g
    assert abs(ahead - behind) / (2 * h) < 1e-7 * (g + k)


@pytest.mark.parametrize("plane", LAWS)
@given(f=deformations, turn=st.floats(-np.pi, np.pi), poisson=poissons)
def test_turning_the_observer(plane, f, turn, poisson):
    """P(R F) = R P(F), and von Mises stays."""
    g, k = numbers(poisson)
    r = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    here = LAWS[plane](f, g, k)
    turned_f = (r @ f.reshape(2, 2)).ravel()
    turned = LAWS[plane](turned_f, g, k)
    expected = (r @ here.stress.reshape(2, 2)).ravel()
    np.testing.assert_allclose(turned.stress, expected, atol=1e-9 * (g + k))
    before, after = (von_mises(x, here.thickness, g) for x in (f, turned_f))
    assert after == pytest.approx(before, rel=1e-9, abs=1e-6)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
def test_small_strain_is_hooke(poisson):
    """E / (1 - nu^2) in plane stress, E (1 - nu) / ((1 + nu) (1 - 2 nu)) in plane strain."""
    g, k = numbers(poisson)
    rest = np.array([1.0, 0, 0, 1.0])
    assert plane_stress(rest, g, k).tangent[0, 0] == pytest.approx(50e3 / (1 - poisson**2))
    stiff = 50e3 * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    assert plane_strain(rest, g, k).tangent[0, 0] == pytest.approx(stiff)


@given(stretch=st.floats(0.4, 2.5))
def test_uniaxial_stretch_of_rubber(stretch):
    """Incompressible limit (Treloar): nominal stress G (s - s^-2)."""
    g, k = moduli(3e4, 0.499999)
    side = stretch**-0.5
    f = np.array([stretch, 0.0, 0.0, side])
    solid = plane_stress(f, np.array(g), np.array(k))
    assert solid.thickness == pytest.approx(side, rel=1e-4)
    # the side is free only near incompressibility: take its stress out through the pressure
    nominal = solid.stress[0] - solid.stress[3] * side / stretch
    assert nominal == pytest.approx(g * (stretch - stretch**-2), abs=2e-3 * g)


@given(f=deformations, poisson=poissons)
def test_von_mises_is_that_of_the_cauchy_stress(f, poisson):
    """sqrt(s11^2 - s11 s22 + s22^2 + 3 s12^2) where nothing pulls across the section."""
    solid = plane_stress(f, *(np.array(m) for m in moduli(50e3, poisson)))
    g, _ = moduli(50e3, poisson)
    deformation = f.reshape(2, 2)
    volume = np.linalg.det(deformation) * solid.thickness
    cauchy = solid.stress.reshape(2, 2) @ deformation.T / volume
    (s11, s12), (_, s22) = cauchy
    wanted = np.sqrt(s11**2 - s11 * s22 + s22**2 + 3 * s12**2)
    found = float(von_mises(f, solid.thickness, np.array(g)))
    assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6 * g)


RNG = np.random.default_rng(1)
F = np.eye(3) + 0.2 * RNG.standard_normal((4, 3, 3))
G, K = np.full(4, 2.0), np.full(4, 30.0)


def test_in_space_stress_and_tangent_are_slopes() -> None:
    stress, tangent = space.stress_and_tangent(F, G, K)
    for a in range(3):
        for b in range(3):
            step = np.zeros((3, 3))
            step[a, b] = 1e-6
            rise = (
                space.energy_density(F + step, G, K) - space.energy_density(F - step, G, K)
            ) / 2e-6
            np.testing.assert_allclose(stress[:, a, b], rise, rtol=1e-6, atol=1e-6)
            ahead, behind = (space.stress_and_tangent(F + s * step, G, K)[0] for s in (1, -1))
            np.testing.assert_allclose(
                tangent[..., a, b], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-5
            )


def test_a_plane_deformation_is_that_of_plane_strain() -> None:
    flat = np.array([[1.1, 0.2, -0.1, 0.95]])
    f = np.eye(3)[None].copy()
    f[0, :2, :2] = flat.reshape(2, 2)
    shear, bulk = np.array([2.0]), np.array([30.0])
    expected = plane_strain(flat, shear, bulk)
    stress, tangent = space.stress_and_tangent(f, shear, bulk)
    np.testing.assert_allclose(stress[0, :2, :2].ravel(), expected.stress[0])
    np.testing.assert_allclose(tangent[0, :2, :2, :2, :2].reshape(4, 4), expected.tangent[0])
    np.testing.assert_allclose(
        space.von_mises(f, shear), von_mises(flat, np.ones(1), shear), rtol=1e-12
    )
