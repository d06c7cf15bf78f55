"""The neo-Hookean material of `sim_backend.fem.material` with all nine components of F.

W = G/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2 (Ogden 1984, sec. 7.2), F (..., 3, 3) = dx_i / dX_J.
"""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array


def determinant_and_cofactor(f: Array) -> tuple[Array, Array]:
    """J (...) and J F^-T (..., 3, 3): row i is the cross product of the two other rows."""
    # component by component, which is contiguous: np.cross takes three times as long
    rows = np.moveaxis(f, (-2, -1), (0, 1)).copy()
    cofactor = np.empty_like(rows)
    following = (1, 2), (2, 0), (0, 1)
    for i, (j, k) in enumerate(following):
        for column, (m, n) in enumerate(following):
            cofactor[i, column] = rows[j, m] * rows[k, n] - rows[j, n] * rows[k, m]
    ratio = np.asarray((rows[0] * cofactor[0]).sum(axis=0))
    return ratio, np.ascontiguousarray(np.moveaxis(cofactor, (0, 1), (-2, -1)))


def volume_change(gradient: Array) -> Array:
    """J - 1 (...) from F - 1, the displacement ``gradient`` (..., 3, 3): its three invariants. Of F
    itself, J - 1 is only known to the rounding of 1, which a bulk modulus makes a stress."""
    third, cofactor = determinant_and_cofactor(gradient)
    first, second = (np.trace(each, axis1=-2, axis2=-1) for each in (gradient, cofactor))
    return np.asarray(first + second + third)


def unforeseen_volume(f: Array, step: Array) -> Array:
    """The part of J (...) at ``f`` that a Newton ``step`` (..., 3, 3) of F did not foresee:
    what is quadratic and cubic in it."""
    before = f - step
    j, _ = determinant_and_cofactor(f)
    j_before, cofactor = determinant_and_cofactor(before)
    return np.asarray(j - j_before - (cofactor * step).sum(axis=(-1, -2)))


@dataclass(frozen=True)
class Response:
    """First Piola-Kirchhoff stress P and its slope, by F and ``h`` (..., 3, 3) = F^-T.

    P = ``by_f`` F + ``by_h`` h and dP_iJ/dF_kL = ``hh`` h_iJ h_kL + ``turned`` h_iL h_kJ
    - ``fh`` (F_iJ h_kL + h_iJ F_kL) + ``by_f`` d_ik d_JL, all [Pa] and (...).
    """

    h: Array
    by_f: Array
    by_h: Array
    hh: Array
    turned: Array
    fh: Array


def response(
    f: Array, shear: Array, bulk: Array, lag: Array | float = 0.0, swelling: Array | None = None
) -> Response:
    """At F ``f`` (..., 3, 3); ``swelling`` (...) is the `volume_change`, where it is known better
    than from ``f``.

    ``lag`` (...) is taken off J where the pressure turns the tangent, and only there: see
    `sim_backend.fem.internal.forces_and_tangents`.
    """
    j, cofactor = determinant_and_cofactor(f)
    by_f = shear * np.cbrt(j) ** -2
    third = by_f * (f * f).sum(axis=(-1, -2)) / 3
    swelling = j - 1 if swelling is None else swelling
    pressure = bulk * swelling * j
    # dF^-T_iJ / dF_kL = -F^-T_iL F^-T_kJ
    turning = bulk * (swelling - lag) * j
    return Response(
        cofactor / _over(j), by_f, pressure - third,
        third * 2 / 3 + bulk * j**2 + turning, third - turning, 2 / 3 * by_f,
    )  # fmt: skip


def stress_and_tangent(
    f: Array, shear: Array, bulk: Array, lag: Array | float = 0.0, swelling: Array | None = None
) -> tuple[Array, Array]:
    """First Piola-Kirchhoff stress (..., 3, 3) [Pa] and dP_iJ/dF_kL (..., 3, 3, 3, 3), as
    `response`."""
    its = response(f, shear, bulk, lag, swelling)
    stress = _over(its.by_f) * f + _over(its.by_h) * its.h
    hh = its.h[..., :, :, None, None] * its.h[..., None, None, :, :]
    fh = f[..., :, :, None, None] * its.h[..., None, None, :, :]
    hf = its.h[..., :, :, None, None] * f[..., None, None, :, :]
    tangent = _over(its.hh, 4) * hh + _over(its.turned, 4) * np.swapaxes(hh, -1, -3)
    tangent -= _over(its.fh, 4) * (fh + hf)
    for a in range(3):
        for b in range(3):
            tangent[..., a, b, a, b] += its.by_f
    return stress, tangent


def cofactor_tangent(f: Array) -> Array:
    """d2J/dF2 (..., 3, 3, 3, 3)."""
    j, cofactor = determinant_and_cofactor(f)
    pairs = cofactor[..., :, :, None, None] * cofactor[..., None, None, :, :]
    return np.asarray((pairs - np.swapaxes(pairs, -1, -3)) / _over(j, 4))


def energy_density(f: Array, shear: Array, bulk: Array) -> Array:
    """W (...) [J/m3]."""
    j, _ = determinant_and_cofactor(f)
    i1 = (f * f).sum(axis=(-1, -2))
    return np.asarray(shear / 2 * (np.cbrt(j) ** -2 * i1 - 3) + bulk / 2 * (j - 1) ** 2)


def von_mises(f: Array, shear: Array) -> Array:
    """Von Mises equivalent (...) [Pa] of the Cauchy stress G J^(-5/3) dev(F F^T)."""
    j, _ = determinant_and_cofactor(f)
    b = f @ np.swapaxes(f, -1, -2)
    b = b - _over(np.trace(b, axis1=-2, axis2=-1) / 3) * np.eye(3)
    return np.asarray(shear * j ** (-5 / 3) * np.sqrt(1.5 * (b * b).sum(axis=(-1, -2))))


def _over(scalar: Array, axes: int = 2) -> Array:
    return np.asarray(scalar.reshape(scalar.shape + (1,) * axes))
