"""Sections that turn about x = 0: hoop stretch, forces and tangents of a body of revolution.

F = [[F11, F12, 0], [F21, F22, 0], [0, 0, F33]] with F33 = 1 + u_r / r (Zienkiewicz, Taylor and
Fox 2014, The Finite Element Method for Solid and Structural Mechanics, sec. 5.3); the material is
the solid's.
"""

from dataclasses import replace

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.elements import Cells, quadrature_points
from sim_backend.fem.material_3d import (
    cofactor_tangent,
    determinant_and_cofactor,
    stress_and_tangent,
    unforeseen_volume,
    volume_change,
)

_IN_USE = np.array([0, 1, 3, 4, 8])
"""F11, F12, F21, F22, F33 of nine."""


def revolved(cells: Cells, nodes: Array) -> Cells:
    """``cells`` of a plane section of ``nodes`` (n, 2) [m], turned about x = 0."""
    values, _ = cells.shape(quadrature_points(cells))
    radius = np.einsum("qk,mk->mq", values, nodes[cells.nodes, 0])
    m, q, _, k = cells.gradient.shape
    hoop = np.zeros((m, q, 2 * k))
    hoop[..., ::2] = values / radius[..., None]
    return replace(cells, hoop=hoop, weight=2 * np.pi * radius * cells.weight)


def hoop_stretch(cells: Cells, u: Array) -> Array:
    """F33 (m, q) at the quadrature points; 1 in a plane."""
    if cells.hoop is None:
        return np.ones(cells.weight.shape)
    return np.asarray(1 + np.einsum("mqd,md->mq", cells.hoop, _local(cells, u)))


def revolved_forces_and_tangents(
    cells: Cells, shear: Array, bulk: Array, u: Array, change: Array | None
) -> tuple[Array, Array]:
    """Element forces (m, d) [N] and tangents (m, d, d) [N/m], as
    `sim_backend.fem.internal.forces_and_tangents`; ``shear``, ``bulk`` (m,) [Pa]."""
    assert cells.hoop is not None
    operator = np.concatenate([cells.operator, cells.hoop[:, :, None]], axis=2)
    gradient = _displacement_gradient(operator, _local(cells, u))
    f, swelling = gradient + np.eye(3), volume_change(gradient)
    lag = np.zeros(f.shape[:2])
    if change is not None:
        lag = unforeseen_volume(f, _displacement_gradient(operator, _local(cells, change)))
    if not cells.dilatation:
        stress, tangent = stress_and_tangent(f, shear[:, None], bulk[:, None], lag, swelling)
        return _integrate(operator, cells.weight, stress, tangent)
    stress, tangent = stress_and_tangent(f, shear[:, None], np.zeros((len(f), 1)))
    _, cofactor = determinant_and_cofactor(f)
    volume = cells.weight.sum(axis=1)
    pressure = bulk * (swelling * cells.weight).sum(axis=1) / volume
    foreseen = pressure - bulk * (lag * cells.weight).sum(axis=1) / volume
    stress = stress + pressure[:, None, None, None] * cofactor
    tangent = tangent + foreseen[:, None, None, None, None, None] * cofactor_tangent(f)
    force, stiffness = _integrate(operator, cells.weight, stress, tangent)
    flat = cofactor.reshape(*cofactor.shape[:2], 9)[..., _IN_USE]
    swell = np.einsum("mq,mqv,mqvd->md", cells.weight, flat, operator, optimize=True)
    stiffness += (bulk / volume)[:, None, None] * swell[:, :, None] * swell[:, None, :]
    return force, stiffness


def _local(cells: Cells, u: Array) -> Array:
    return np.asarray(u[cells.nodes].reshape(len(cells.nodes), -1))


def _displacement_gradient(operator: Array, local: Array) -> Array:
    """F - 1 (m, q, 3, 3)."""
    five = np.einsum("mqvd,md->mqv", operator, local)
    f = np.zeros((*five.shape[:2], 9))
    f[..., _IN_USE] = five
    return f.reshape(*five.shape[:2], 3, 3)


def _integrate(
    operator: Array, weight: Array, stress: Array, tangent: Array
) -> tuple[Array, Array]:
    m, q, v, d = operator.shape
    five = stress.reshape(m, q, 9)[..., _IN_USE] * weight[..., None]
    moduli = tangent.reshape(m, q, 9, 9)[..., _IN_USE[:, None], _IN_USE] * weight[..., None, None]
    turned = np.swapaxes(operator.reshape(m, q * v, d), 1, 2)
    force = (turned @ five.reshape(m, q * v, 1))[..., 0]
    return force, turned @ (moduli @ operator).reshape(m, q * v, d)
