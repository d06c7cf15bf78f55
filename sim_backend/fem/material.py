"""Compressible neo-Hookean material in a plane section.

W = G/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2 with I1 = tr(F^T F) and J = det F (Ogden 1984, sec. 7.2;
in CalculiX: C10 = G/2, D1 = 2/K). F is written as [F11, F12, F21, F22] on its last axis; the
stretch across the section l3 is 1 in plane strain and free of stress in plane stress.
"""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array

_UNIT = np.eye(4)
_EPSILON = np.array([[0.0, 1.0], [-1.0, 0.0]])
# (i, J), (k, L) -> eps_ik eps_JL
_TWIST: Array = np.einsum("ik,jl->ijkl", _EPSILON, _EPSILON).reshape(4, 4)
_THICKNESS_SWEEPS = 40


@dataclass(frozen=True)
class Stressed:
    """First Piola-Kirchhoff ``stress`` (..., 4) [Pa], its ``tangent`` (..., 4, 4), the stretch
    across the section ``thickness`` (...) and its derivative ``thinning`` (..., 4) by F."""

    stress: Array
    tangent: Array
    thickness: Array
    thinning: Array


def moduli(modulus_pa: float, poisson: float) -> tuple[float, float]:
    """Shear and bulk modulus [Pa]."""
    return modulus_pa / (2 * (1 + poisson)), modulus_pa / (3 * (1 - 2 * poisson))


def inverse_transpose(f: Array, j: Array) -> Array:
    """Cofactors over the determinant: F^-T (..., 4) for ``j`` = det F (...)."""
    h = np.stack([f[..., 3], -f[..., 2], -f[..., 1], f[..., 0]], axis=-1)
    return np.asarray(h / j[..., None])


def area_ratio(f: Array) -> Array:
    """det F (...) in the plane."""
    return np.asarray(f[..., 0] * f[..., 3] - f[..., 1] * f[..., 2])


def plane_strain(f: Array, shear: Array, bulk: Array, lag: Array | float = 0.0) -> Stressed:
    """``f`` (..., 4), ``shear`` and ``bulk`` (...) [Pa].

    ``lag`` (...) is taken off J where the pressure turns the tangent, and only there: see
    `sim_backend.fem.internal.forces_and_tangents`.
    """
    stress, tangent, j, cofactor = isochoric(f, shear)
    stress = stress + (bulk * (j - 1))[..., None] * cofactor
    tangent = tangent + bulk[..., None, None] * cofactor[..., :, None] * cofactor[..., None, :]
    tangent = tangent + (bulk * (j - 1 - lag))[..., None, None] * _TWIST
    return Stressed(stress, tangent, np.ones_like(j), np.zeros_like(f))


def plane_stress(f: Array, shear: Array, bulk: Array) -> Stressed:
    """As `plane_strain`, with the thickness condensed out of the tangent."""
    j = area_ratio(f)
    l3 = stress_free_thickness(f, j, shear, bulk)
    stress, tangent = _in_plane(f, j, l3, shear, bulk)
    scale = shear / np.cbrt(j * l3) ** 2
    i1 = (f * f).sum(axis=-1) + l3**2
    h = inverse_transpose(f, j)
    # a = dP/dl3, m = dP33/dl3: the thickness adjusts until P33 = 0
    iso = (scale / l3)[..., None] * (
        -2 / 3 * (f - (i1 / 3)[..., None] * h) - (2 / 3 * l3**2)[..., None] * h
    )
    volume = bulk * (2 * (j * l3) ** 2 - j * l3) / l3
    a = iso + volume[..., None] * h
    m = _thickness_stiffness(i1, j, l3, scale, bulk)
    thinning = -a / m[..., None]
    tangent = tangent + a[..., :, None] * thinning[..., None, :]
    return Stressed(stress, tangent, l3, thinning)


def stress_free_thickness(f: Array, j: Array, shear: Array, bulk: Array) -> Array:
    """Stretch l3 (...) at which P33 = 0, by Newton from the incompressible 1 / det F."""
    plane = (f * f).sum(axis=-1)
    l3 = 1 / j
    for _ in range(_THICKNESS_SWEEPS):
        i1 = plane + l3**2
        scale = shear / np.cbrt(j * l3) ** 2
        p33 = scale * (l3 - i1 / (3 * l3)) + bulk * (j * l3 - 1) * j
        change = p33 / _thickness_stiffness(i1, j, l3, scale, bulk)
        l3 = np.maximum(l3 - change, 0.1 * l3)
        if np.all(np.abs(change) < 1e-8 * l3):  # the next would be its square
            break
    thickness: Array = l3
    return thickness


def isochoric(f: Array, shear: Array) -> tuple[Array, Array, Array, Array]:
    """Plane strain without the bulk term: stress, tangent, j (...) and the cofactor dj/dF."""
    j = area_ratio(f)
    one = np.ones_like(j)
    stress, tangent = _in_plane(f, j, one, shear, np.zeros_like(j))
    cofactor = np.stack([f[..., 3], -f[..., 2], -f[..., 1], f[..., 0]], axis=-1)
    return stress, tangent, j, cofactor


def cofactor_tangent() -> Array:
    """d2j/dF2 (4, 4): constant, since j is bilinear."""
    return _TWIST


def energy_density(f: Array, thickness: Array, shear: Array, bulk: Array) -> Array:
    """W (...) [J/m3]."""
    volume = area_ratio(f) * thickness
    i1 = (f * f).sum(axis=-1) + thickness**2
    return np.asarray(shear / 2 * (volume ** (-2 / 3) * i1 - 3) + bulk / 2 * (volume - 1) ** 2)


def von_mises(f: Array, thickness: Array, shear: Array) -> Array:
    """Von Mises equivalent (...) [Pa] of the Cauchy stress.

    Only the deviator G J^(-5/3) dev(F F^T) enters; the volumetric stress drops out.
    """
    volume = area_ratio(f) * thickness
    b11 = f[..., 0] ** 2 + f[..., 1] ** 2
    b22 = f[..., 2] ** 2 + f[..., 3] ** 2
    b12 = f[..., 0] * f[..., 2] + f[..., 1] * f[..., 3]
    b33 = thickness**2
    mean = (b11 + b22 + b33) / 3
    square = (b11 - mean) ** 2 + (b22 - mean) ** 2 + (b33 - mean) ** 2 + 2 * b12**2
    return np.asarray(shear * volume ** (-5 / 3) * np.sqrt(1.5 * square))


def _in_plane(f: Array, j: Array, l3: Array, shear: Array, bulk: Array) -> tuple[Array, Array]:
    """P = dW/dF (..., 4) and dP/dF (..., 4, 4) at fixed l3."""
    volume = j * l3
    i1 = (f * f).sum(axis=-1) + l3**2
    scale = shear / np.cbrt(volume) ** 2
    h = inverse_transpose(f, j)
    pressure = bulk * (volume - 1) * volume
    stress = scale[..., None] * (f - (i1 / 3)[..., None] * h) + pressure[..., None] * h
    # d(F^-T)/dF = -(H H - eps eps / j) with the two inner indices swapped; all but the unit and the
    # twist is g H + H g
    turning = scale * i1 / 3 - pressure
    along = scale * 2 / 9 * i1 + bulk * (2 * volume**2 - volume) + turning
    g = (along / 2)[..., None] * h - (2 / 3 * scale)[..., None] * f
    half = g[..., :, None] * h[..., None, :]
    tangent = half + np.swapaxes(half, -1, -2)
    tangent[..., range(4), range(4)] += scale[..., None]
    tangent[..., *np.nonzero(_TWIST)] -= (turning / j)[..., None] * _TWIST[_TWIST != 0]
    return stress, tangent


def _thickness_stiffness(i1: Array, j: Array, l3: Array, scale: Array, bulk: Array) -> Array:
    """dP33/dl3 (...) [Pa] at fixed F."""
    q = l3 - i1 / (3 * l3)
    return np.asarray(scale * (-2 * q / (3 * l3) + 1 / 3 + i1 / (3 * l3**2)) + bulk * j**2)
