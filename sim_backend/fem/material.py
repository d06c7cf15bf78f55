"""Compressible neo-Hookean material in a plane section.

W = G/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2 with I1 = tr(F^T F) and J = det F (Ogden 1984, sec. 7.2;
in CalculiX: C10 = G/2, D1 = 2/K). F is written as [F11, F12, F21, F22] on its last axis; the
stretch across the section l3 is 1 in plane strain and free of stress in plane stress. Inside, these
four are on the first axis: numpy is quick over long last axes only.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim_backend.arrays import Array

_EPSILON = np.array([[0.0, 1.0], [-1.0, 0.0]])
# (i, J), (k, L) -> eps_ik eps_JL
_TWIST: Array = np.einsum("ik,jl->ijkl", _EPSILON, _EPSILON).reshape(4, 4)
_THICKNESS_SWEEPS = 40


@dataclass(frozen=True)
class Stressed:
    """First Piola-Kirchhoff ``stress`` (..., 4) [Pa] and the stretch across the section
    ``thickness`` (...). The tangent is formed where it is asked for: often stresses will do."""

    stress: Array
    thickness: Array
    form_tangent: Callable[[], Array]

    @cached_property
    def tangent(self) -> Array:
        """dP/dF (..., 4, 4) [Pa]."""
        return self.form_tangent()


def moduli(modulus_pa: float, poisson: float) -> tuple[float, float]:
    """Shear and bulk modulus [Pa]."""
    return modulus_pa / (2 * (1 + poisson)), modulus_pa / (3 * (1 - 2 * poisson))


def area_ratio(f: Array) -> Array:
    """det F (...) in the plane."""
    return np.asarray(f[..., 0] * f[..., 3] - f[..., 1] * f[..., 2])


def area_change(gradient: Array) -> Array:
    """det F - 1 (...) from F - 1, the displacement ``gradient`` (..., 4). Of F itself, det F - 1
    is only known to the rounding of 1, which a bulk modulus makes a stress."""
    return np.asarray(gradient[..., 0] + gradient[..., 3] + area_ratio(gradient))


def plane_strain(
    f: Array, shear: Array, bulk: Array, lag: Array | float = 0.0, swelling: Array | None = None
) -> Stressed:
    """``f`` (..., 4), ``shear`` and ``bulk`` (...) [Pa]; ``swelling`` (...) is the `area_change`,
    where it is known better than from ``f``.

    ``lag`` (...) is taken off J where the pressure turns the tangent, and only there: see
    `sim_backend.fem.internal.forces_and_tangents`.
    """
    rigid, j, cofactor = isochoric(f, shear)
    volume_change = j - 1 if swelling is None else swelling
    stress = rigid.stress + (bulk * volume_change)[..., None] * cofactor

    def tangent() -> Array:
        stiff = bulk[..., None, None] * cofactor[..., :, None] * cofactor[..., None, :]
        turning = (bulk * (volume_change - lag))[..., None, None] * _TWIST
        return np.asarray(rigid.tangent + stiff + turning)

    return Stressed(stress, rigid.thickness, tangent)


def plane_stress(f: Array, shear: Array, bulk: Array) -> Stressed:
    """As `plane_strain`, with the thickness condensed out of the tangent."""
    f, shear, bulk = _first(f, shear, bulk)
    # the thickness adjusts until P33 = 0, which takes a a / m off the tangent
    thin = _thinned(f, shear, bulk)
    # G J^(-2/3) I1 / 3 - K (J - 1) J by P33 = 0: so the bulk modulus magnifies no rounding of J - 1
    return _in_plane(f, thin, bulk, thin.scale * thin.l3**2)


def thinning(f: Array, shear: Array, bulk: Array) -> tuple[Array, Array]:
    """``thickness`` of `plane_stress` and its derivative (..., 4) by F."""
    f, shear, bulk = _first(f, shear, bulk)
    thin = _thinned(f, shear, bulk)
    return thin.l3, _last(_thinning(f, thin))


class _Thin(NamedTuple):
    """At a thickness ``l3`` (...): j, J = j l3, F^-T ``h`` (4, ...), I1, G J^(-2/3), and
    a = dP/dl3 = by_f F + by_h h over m = dP33/dl3, the ``stiffness``."""

    l3: Array
    j: Array
    volume: Array
    h: Array
    i1: Array
    scale: Array
    by_f: Array
    by_h: Array
    stiffness: Array


def _thinned(f: Array, shear: Array, bulk: Array) -> _Thin:
    """Where P33 = 0."""
    j = f[0] * f[3] - f[1] * f[2]
    plane = (f * f).sum(axis=0)
    root = _stress_free_root(plane, j, shear, bulk)
    volume = root**3
    l3 = volume / j
    i1, scale = plane + l3**2, shear / root**2
    by_h = (scale * (2 / 9 * i1 - 2 / 3 * l3**2) + bulk * (2 * volume - 1) * volume) / l3
    stiffness = _thickness_stiffness(i1, j, l3, scale, bulk)
    by_f = -2 / 3 * scale / l3
    return _Thin(l3, j, volume, _cofactor(f) / j, i1, scale, by_f, by_h, stiffness)


def _thinning(f: Array, thin: _Thin) -> Array:
    """dl3/dF (4, ...) = -a / m."""
    return np.asarray((thin.by_f * f + thin.by_h * thin.h) / -thin.stiffness)


def _stress_free_root(plane: Array, j: Array, shear: Array, bulk: Array) -> Array:
    """Cube root w (...) of J at which P33 = 0, by Newton from 1; ``plane`` is tr(F^T F).

    3 P33 / j = G (2 w / j^2 - tr / w^5) + 3 K (w^3 - 1), which rises everywhere.
    """
    root, out, back = np.ones_like(j), 2 * shear / j**2, shear * plane
    for _ in range(_THICKNESS_SWEEPS):
        square = root * root
        fifth = back / (square * square * root)
        rise = out + 5 * fifth / root + 9 * bulk * square
        change = (out * root - fifth + 3 * bulk * (square * root - 1)) / rise
        root = np.maximum(root - change, 0.5 * root)
        if np.all(np.abs(change) < 1e-8 * root):  # the next would be its square
            break
    return root


def isochoric(f: Array, shear: Array) -> tuple[Stressed, Array, Array]:
    """Plane strain without the bulk term; j (...) and the cofactor dj/dF (..., 4)."""
    f, shear, none = _first(f, shear, np.zeros_like(shear))
    j = f[0] * f[3] - f[1] * f[2]
    one, cofactor = np.ones_like(j), _cofactor(f)
    i1 = (f * f).sum(axis=0) + 1
    rigid = _Thin(one, j, j, cofactor / j, i1, shear / np.cbrt(j) ** 2, none, none, one)
    return _in_plane(f, rigid, none, rigid.scale * i1 / 3), j, _last(cofactor)


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


def _in_plane(f: Array, thin: _Thin, bulk: Array, turning: Array) -> Stressed:
    """P = dW/dF and dP/dF with the thickness' a a / m taken off; ``f`` (4, ...). ``turning`` (...)
    is what F^-T is taken by."""
    h, volume, i1, scale = thin.h, thin.volume, thin.i1, thin.scale

    def tangent() -> Array:
        # d(F^-T)/dF = -(H H - eps eps / j) with the two inner indices swapped
        soft = thin.by_h / thin.stiffness
        of_h = scale * 2 / 9 * i1 + bulk * (2 * volume - 1) * volume + turning - thin.by_h * soft
        of_both = -2 / 3 * scale - thin.by_f * soft
        of_f = -(thin.by_f**2) / thin.stiffness
        with_h, with_f = of_h * h + of_both * f, of_both * h + of_f * f
        found = h[:, None] * with_h
        found += f[:, None] * with_f
        for both in range(4):
            found[both, both] += scale
        turned = turning / thin.j
        for row, column in zip(*np.nonzero(_TWIST), strict=True):
            found[row, column] -= _TWIST[row, column] * turned
        return _last(found, 2)

    return Stressed(_last(scale * f - turning * h), thin.l3, tangent)


def _first(f: Array, shear: Array, bulk: Array) -> tuple[Array, Array, Array]:
    """``f`` (..., 4) as (4, ...), and both moduli at every point."""
    f = np.ascontiguousarray(f.transpose(f.ndim - 1, *range(f.ndim - 1)))
    none = np.zeros_like(f[0])
    return f, shear + none, bulk + none


def _last(components: Array, axes: int = 1) -> Array:
    """(4, ...) as (..., 4); with 2 ``axes``, (4, 4, ...) as (..., 4, 4)."""
    back = tuple(range(axes, components.ndim)) + tuple(range(axes))
    return np.ascontiguousarray(components.transpose(back))


def _cofactor(f: Array) -> Array:
    found = np.empty_like(f)
    found[0], found[3] = f[3], f[0]
    np.negative(f[2:0:-1], out=found[1:3])
    return found


def _thickness_stiffness(i1: Array, j: Array, l3: Array, scale: Array, bulk: Array) -> Array:
    """dP33/dl3 (...) [Pa] at fixed F."""
    q = l3 - i1 / (3 * l3)
    return np.asarray(scale * (-2 * q / (3 * l3) + 1 / 3 + i1 / (3 * l3**2)) + bulk * j**2)
