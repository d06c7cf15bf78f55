"""Internal forces and exact tangents of all cells, total Lagrangian."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem import kernel
from sim_backend.fem.elements import HOURGLASS, Cells
from sim_backend.fem.material import (
    Stressed,
    area_change,
    area_ratio,
    cofactor_tangent,
    isochoric,
    plane_strain,
    plane_stress,
)
from sim_backend.fem.revolved import revolved_forces_and_tangents


class Elastic(Protocol):
    """Cells and what they are made of: ``shear`` and ``bulk`` (m,) [Pa]."""

    @property
    def cells(self) -> Cells: ...

    @property
    def shear(self) -> Array: ...

    @property
    def bulk(self) -> Array: ...

    @property
    def plane_stress(self) -> bool: ...


_AT_REST = np.array([1.0, 0.0, 0.0, 1.0])


def deformation(section: Elastic, u: Array) -> Array:
    """F (m, q, 4) at the quadrature points for displacements ``u`` (n, 2) [m]."""
    return np.asarray(displacement_gradient(section, u) + _AT_REST)


def displacement_gradient(section: Elastic, u: Array) -> Array:
    """F - 1 (m, q, 4), as `deformation`."""
    cells = section.cells
    m, q, _, d = cells.operator.shape
    local = u[cells.nodes].reshape(m, d, 1)
    return np.asarray((cells.operator.reshape(m, q * 4, d) @ local).reshape(m, q, 4))


def smallest_area_ratio(section: Elastic, u: Array) -> tuple[float, int]:
    """The smallest det F and the cell where it is."""
    j = area_ratio(deformation(section, u)).min(axis=1)
    worst = int(np.argmin(j))
    return float(j[worst]), worst


def least_area_ratio(section: Elastic, u: Array) -> float:
    """The smallest det F."""
    if kernel.BUILT:
        return kernel.least_area_ratio(*_for_kernel(section, u))
    return float(area_ratio(deformation(section, u)).min())


def forces_and_tangents(section: Elastic, u: Array) -> tuple[Array, Array]:
    """Element forces (m, d) [N/m] and tangents (m, d, d) [Pa]."""
    force, tangents = internal_forces(section, u)
    return force, tangents()


def internal_forces(
    section: Elastic, u: Array, change: Array | None = None
) -> tuple[Array, Callable[[], Array]]:
    """Element forces (m, d) [N/m], and what forms their tangents (m, d, d) [Pa] where they are
    wanted, as long as ``u`` stays: that takes longer.

    ``change`` (n, 2) is the step that led to ``u``. In plane strain the pressure that turns with
    the body then enters the tangent as the step foresaw it, without the step's quadratic part
    det(dF): that part times the bulk modulus can be far larger than any true pressure and sends
    Newton astray (the mixed point of Magisano, Leonetti and Garcea 2017). Forces are unaffected,
    and at convergence the tangent is exact.
    """
    cells = section.cells
    if cells.hoop is not None:
        force, tangent = revolved_forces_and_tangents(cells, section.shear, section.bulk, u, change)
        return force, lambda: tangent
    force, tangents = (_by_kernel if kernel.BUILT else _by_numpy)(section, u, change)
    return (force, tangents) if cells.hourglass is None else _held(section, u, force, tangents)


def _for_kernel(section: Elastic, u: Array) -> tuple[Array, Ints, Array, Array, Array, Array, int]:
    cells = section.cells
    law = 0 if section.plane_stress else 2 if cells.dilatation else 1
    return (np.ascontiguousarray(u), cells.nodes, cells.gradient, cells.weight, section.shear,
            section.bulk, law)  # fmt: skip


def _by_kernel(
    section: Elastic, u: Array, change: Array | None
) -> tuple[Array, Callable[[], Array]]:
    given = _for_kernel(section, u)
    m, d = section.cells.dofs.shape
    force, thickness = np.empty((m, d)), np.empty(section.cells.weight.shape)
    kernel.cell_forces(*given, force, thickness)

    def tangents() -> Array:
        found = np.empty((m, d, d))
        kernel.cell_tangents(*given, thickness, found, change)
        return found

    return force, tangents


def _by_numpy(
    section: Elastic, u: Array, change: Array | None
) -> tuple[Array, Callable[[], Array]]:
    gradient = displacement_gradient(section, u)
    f, swelling = gradient + _AT_REST, area_change(gradient)
    shear, bulk = section.shear[:, None], section.bulk[:, None]
    if section.plane_stress:
        return _integrated(section, plane_stress(f, shear, bulk))
    moved = displacement_gradient(section, change) if change is not None else 0 * f
    lag = area_ratio(moved)
    if section.cells.dilatation:
        return _one_dilatation(section, f, swelling, lag)
    return _integrated(section, plane_strain(f, shear, bulk, lag, swelling))


def _integrated(section: Elastic, solid: Stressed) -> tuple[Array, Callable[[], Array]]:
    return (
        _forces(section.cells, solid.stress),
        lambda: _tangents(section.cells, solid.tangent),
    )


def _forces(cells: Cells, stress: Array) -> Array:
    m, q, v, d = cells.operator.shape
    weighted = (stress * cells.weight[..., None]).reshape(m, q * v, 1)
    return np.asarray((np.swapaxes(cells.operator.reshape(m, q * v, d), 1, 2) @ weighted)[..., 0])


def _tangents(cells: Cells, tangent: Array) -> Array:
    m, q, v, d = cells.operator.shape
    moved = ((tangent * cells.weight[..., None, None]) @ cells.operator).reshape(m, q * v, d)
    return np.asarray(np.swapaxes(cells.operator.reshape(m, q * v, d), 1, 2) @ moved)


def _one_dilatation(
    section: Elastic, f: Array, swelling: Array, lag: Array
) -> tuple[Array, Callable[[], Array]]:
    """K/2 (mean J - 1)^2 on the element's mean volume change (Nagtegaal et al. 1974; the mean
    dilatation method of Simo, Taylor and Pister 1985 with a constant pressure)."""
    cells = section.cells
    rigid, _, cofactor = isochoric(f, section.shear[:, None])
    area = cells.weight.sum(axis=1)
    pressure = section.bulk * (swelling * cells.weight).sum(axis=1) / area

    def tangents() -> Array:
        foreseen = pressure - section.bulk * (lag * cells.weight).sum(axis=1) / area
        turning = foreseen[:, None, None, None] * cofactor_tangent()
        stiffness = _tangents(cells, rigid.tangent + turning)
        swell = np.einsum("mq,mqv,mqvd->md", cells.weight, cofactor, cells.operator, optimize=True)
        stiffness += (section.bulk / area)[:, None, None] * swell[:, :, None] * swell[:, None, :]
        return stiffness

    return _forces(cells, rigid.stress + pressure[:, None, None] * cofactor), tangents


def hourglass_stiffness(section: Elastic) -> Array:
    """Stiffness (m,) [Pa] that holds each pattern (Flanagan and Belytschko 1981, eq. 59)."""
    cells = section.cells
    gradient = cells.gradient[:, 0]
    size = (gradient**2).sum(axis=(1, 2)) * cells.weight[:, 0]
    # the shear modulus, not the bulk: a stiffness by the bulk would lock near nu = 0.5
    return np.asarray(HOURGLASS * 4 * section.shear * size)


def _held(
    section: Elastic, u: Array, force: Array, tangents: Callable[[], Array]
) -> tuple[Array, Callable[[], Array]]:
    """With the hourglass forces and their constant stiffness."""
    gamma = section.cells.hourglass
    assert gamma is not None
    stiffness = hourglass_stiffness(section)
    amplitude = np.einsum("mk,mki->mi", gamma, u[section.cells.nodes])
    for axis in (0, 1):
        force[:, axis::2] += (stiffness * amplitude[:, axis])[:, None] * gamma

    def stiffer() -> Array:
        found = tangents()
        for axis in (0, 1):
            found[:, axis::2, axis::2] += (
                stiffness[:, None, None] * gamma[:, :, None] * gamma[:, None, :]
            )
        return found

    return force, stiffer
