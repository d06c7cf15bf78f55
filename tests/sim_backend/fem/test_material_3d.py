"""The material in space: stress and tangent are the energy's derivatives, and the plane's."""

import numpy as np

from sim_backend.fem import material as plane
from sim_backend.fem.material_3d import energy_density, stress_and_tangent, von_mises

RNG = np.random.default_rng(1)
F = np.eye(3) + 0.2 * RNG.standard_normal((4, 3, 3))
G, K = np.full(4, 2.0), np.full(4, 30.0)


def test_stress_and_tangent_by_differences() -> None:
    stress, tangent = stress_and_tangent(F, G, K)
    for a in range(3):
        for b in range(3):
            step = np.zeros((3, 3))
            step[a, b] = 1e-6
            rise = (energy_density(F + step, G, K) - energy_density(F - step, G, K)) / 2e-6
            np.testing.assert_allclose(stress[:, a, b], rise, rtol=1e-6, atol=1e-6)
            ahead, behind = (stress_and_tangent(F + s * step, G, K)[0] for s in (1, -1))
            np.testing.assert_allclose(
                tangent[..., a, b], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-5
            )


def test_a_plane_deformation_is_that_of_plane_strain() -> None:
    flat = np.array([[1.1, 0.2, -0.1, 0.95]])
    f = np.eye(3)[None].copy()
    f[0, :2, :2] = flat.reshape(2, 2)
    shear, bulk = np.array([2.0]), np.array([30.0])
    expected = plane.plane_strain(flat, shear, bulk)
    stress, tangent = stress_and_tangent(f, shear, bulk)
    np.testing.assert_allclose(stress[0, :2, :2].ravel(), expected.stress[0])
    np.testing.assert_allclose(tangent[0, :2, :2, :2, :2].reshape(4, 4), expected.tangent[0])
    np.testing.assert_allclose(
        von_mises(f, shear), plane.von_mises(flat, np.ones(1), shear), rtol=1e-12
    )
