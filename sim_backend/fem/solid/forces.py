"""Internal forces and exact tangents of wedges, and the pressure on a lumen's faces."""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array, Ints, Singles
from sim_backend.fem import kernel
from sim_backend.fem.material_3d import (
    determinant_and_cofactor,
    response,
    unforeseen_volume,
)
from sim_backend.fem.solid.prism import Wedges

_CHUNK = 100
"""Wedges at a time: their tangents' parts stay in the cache and below 100 MB."""


@dataclass(frozen=True)
class Faces:
    """Faces (s, k) of a lumen with shape functions ``value`` (q, k), slopes ``by_a`` and ``by_b``
    (q, k) and weights (q,): da x db points from the lumen into the wall."""

    nodes: Ints
    value: Array
    by_a: Array
    by_b: Array
    weight: Array

    @property
    def dofs(self) -> Ints:
        """(s, 3k): displacement numbers of each face, by direction."""
        return (3 * self.nodes[:, None] + np.arange(3)[:, None]).reshape(len(self.nodes), -1)


def deformation(wedges: Wedges, u: Array) -> Array:
    """F (m, 9, 3, 3) at the quadrature points for displacements ``u`` (n, 3) [m]."""
    moved = np.swapaxes(u[wedges.cells], 1, 2)[:, None]  # (m, 1, 3, 18)
    return np.asarray(moved @ wedges.gradient + np.eye(3))


def volume_ratios(wedges: Wedges, u: Array) -> Array:
    """The smallest det F of each wedge (m,)."""
    return np.asarray(determinant_and_cofactor(deformation(wedges, u))[0].min(axis=1))


def smallest_volume_ratio(wedges: Wedges, u: Array) -> tuple[float, int]:
    """The smallest det F and the wedge where it is."""
    j = volume_ratios(wedges, u)
    worst = int(np.argmin(j))
    return float(j[worst]), worst


def forces(wedges: Wedges, shear: Array, bulk: Array, u: Array) -> Array:
    """Wedge forces (m, 54) [N] at displacements ``u`` (n, 3) [m]; ``shear``, ``bulk`` (m,) [Pa]."""
    f = deformation(wedges, u)
    its = response(f, shear[:, None], bulk[:, None])
    stress = its.by_f[..., None, None] * f + its.by_h[..., None, None] * its.h
    stress *= wedges.weight[..., None, None]
    m, q = wedges.weight.shape
    rows = np.swapaxes(stress, 1, 2).reshape(m, 3, 3 * q)  # (m, i, qk)
    return (rows @ np.swapaxes(wedges.gradient, 2, 3).reshape(m, 3 * q, 18)).reshape(m, 54)


def tangents(
    wedges: Wedges,
    shear: Array,
    bulk: Array,
    u: Array,
    change: Array | None = None,
    rough: bool = False,
) -> Singles:
    """Wedge tangents (m, 54, 54) [N/m] of `forces`, in single precision: Newton's steps are not
    solved as closely.

    ``change`` (n, 3) is the Newton step that led to ``u``: the pressure in the tangent is then the
    one that it foresaw. Where ``u`` is a ``rough`` guess, its changes of volume mean nothing, and
    the tangent has no pressure.
    """
    f = deformation(wedges, u)
    lag = np.zeros(f.shape[:2])
    if change is not None:
        lag = unforeseen_volume(f, deformation(wedges, change) - np.eye(3))
    if rough:
        lag = determinant_and_cofactor(f)[0] - 1
    its = response(f, shear[:, None], bulk[:, None], lag)
    slopes = np.stack([its.hh, its.turned, its.fh, its.by_f], axis=-1) * wedges.weight[..., None]
    tangent = np.empty((len(f), 54, 54), dtype=np.float32)
    if kernel.BUILT:
        kernel.wedge_tangents(wedges.gradient, f, its.h, slopes, tangent)
        return tangent
    for start in range(0, len(f), _CHUNK):
        part = slice(start, start + _CHUNK)
        tangent[part] = _tangents(wedges.gradient[part], f[part], its.h[part], slopes[part])
    return tangent


def _tangents(gradient: Array, f: Array, h: Array, slopes: Array) -> Singles:
    """(m, 54, 54) of gradients (m, q, 18, 3), F and h (m, q, 3, 3), and (m, q, 4) of `Response`'s
    ``hh``, ``turned``, ``fh`` and ``by_f``, each times the point's weight."""
    g = np.swapaxes(gradient, 2, 3).astype(np.float32)
    hh, turned, fh, by_f = np.moveaxis(slopes.astype(np.float32), -1, 0)[..., None, None]
    # of dP/dF what is left with the gradients g: F g and h g, (m, q, i, k)
    f_g, h_g = (each.astype(np.float32) @ g for each in (f, h))
    rows, half = _rows(h_g), _rows(0.5 * hh * h_g - fh * f_g)
    left, right = np.concatenate([half, rows], axis=1), np.concatenate([rows, half], axis=1)
    whole = (np.swapaxes(left, 1, 2) @ right).reshape(-1, 3, 18, 3, 18)
    swapped = (np.swapaxes(_rows(turned * h_g), 1, 2) @ rows).reshape(-1, 3, 18, 3, 18)
    tangent = whole + np.swapaxes(swapped, 1, 3)
    points = (len(f), -1, 18)
    alike = np.swapaxes((by_f * g).reshape(points), 1, 2) @ g.reshape(points)
    for i in range(3):
        tangent[:, i, :, i] += alike
    return np.asarray(tangent.reshape(-1, 54, 54))


def _rows(each: Singles) -> Singles:
    """(m, q, 3, 18) as (m, q, 54)."""
    return each.reshape(*each.shape[:2], 54)


def unit_pressure(faces: Faces, place: Array) -> tuple[Array, Array]:
    """Forces (s, 3k) on deformed faces ``place`` (n, 3) [m] at 1 Pa, and their tangent."""
    here = place[faces.nodes]
    s, k = faces.nodes.shape
    a = np.einsum("qk,ski->sqi", faces.by_a, here)
    b = np.einsum("qk,ski->sqi", faces.by_b, here)
    weighted = faces.weight[:, None] * faces.value
    force = np.einsum("qk,sqi->sik", weighted, np.cross(a, b))
    turn = np.einsum("ql,sqij->sqlij", faces.by_b, _spin(a))
    turn -= np.einsum("ql,sqij->sqlij", faces.by_a, _spin(b))
    stiffness = np.einsum("qk,sqlij->sikjl", weighted, turn, optimize=True)
    return force.reshape(s, 3 * k), stiffness.reshape(s, 3 * k, 3 * k)


def _spin(v: Array) -> Array:
    """(..., 3) as the matrix (..., 3, 3) of the cross product v x."""
    spin = np.zeros((*v.shape, 3))
    spin[..., 0, 1], spin[..., 0, 2], spin[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    spin[..., 1, 0], spin[..., 2, 0], spin[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return spin
