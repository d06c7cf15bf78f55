"""Internal forces and exact tangents of all cells, total Lagrangian."""

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.elements import HOURGLASS
from sim_backend.fem.material import (
    area_ratio,
    cofactor_tangent,
    isochoric,
    plane_strain,
    plane_stress,
)
from sim_backend.fem.model import Section
from sim_backend.fem.revolved import revolved_forces_and_tangents

_AT_REST = np.array([1.0, 0.0, 0.0, 1.0])


def deformation(section: Section, u: Array) -> Array:
    """F (m, q, 4) at the quadrature points for displacements ``u`` (n, 2) [m]."""
    cells = section.cells
    m, q, _, d = cells.operator.shape
    local = u[cells.nodes].reshape(m, d, 1)
    f = (cells.operator.reshape(m, q * 4, d) @ local).reshape(m, q, 4)
    f[..., 0] += 1.0
    f[..., 3] += 1.0
    return f


def smallest_area_ratio(section: Section, u: Array) -> tuple[float, int]:
    """The smallest det F and the cell where it is."""
    j = area_ratio(deformation(section, u)).min(axis=1)
    worst = int(np.argmin(j))
    return float(j[worst]), worst


def forces_and_tangents(
    section: Section, u: Array, change: Array | None = None
) -> tuple[Array, Array]:
    """Element forces (m, d) [N/m] and tangents (m, d, d) [Pa].

    ``change`` (n, 2) is the step that led to ``u``. In plane strain the pressure that turns with
    the body then enters the tangent as the step foresaw it, without the step's quadratic part
    det(dF): that part times the bulk modulus can be far larger than any true pressure and sends
    Newton astray (the mixed point of Magisano, Leonetti and Garcea 2017). Forces are unaffected,
    and at convergence the tangent is exact.
    """
    cells = section.cells
    if cells.hoop is not None:
        return revolved_forces_and_tangents(cells, section.shear, section.bulk, u, change)
    f = deformation(section, u)
    shear, bulk = section.shear[:, None], section.bulk[:, None]
    if section.plane_stress:
        solid = plane_stress(f, shear, bulk)
        force, tangent = _integrate(cells.operator, cells.weight, solid.stress, solid.tangent)
    else:
        moved = deformation(section, change) - _AT_REST if change is not None else 0 * f
        lag = area_ratio(moved)
        if cells.dilatation:
            force, tangent = _one_dilatation(section, f, lag)
        else:
            solid = plane_strain(f, shear, bulk, lag)
            force, tangent = _integrate(cells.operator, cells.weight, solid.stress, solid.tangent)
    if cells.hourglass is not None:
        _hold_hourglass(section, u, force, tangent)
    return force, tangent


def _integrate(
    operator: Array, weight: Array, stress: Array, tangent: Array
) -> tuple[Array, Array]:
    m, q, _, d = operator.shape
    stacked = operator.reshape(m, q * 4, d)
    transposed = np.swapaxes(stacked, 1, 2)
    weighted = (stress * weight[..., None]).reshape(m, q * 4, 1)
    force = (transposed @ weighted)[..., 0]
    moved = ((tangent * weight[..., None, None]) @ operator).reshape(m, q * 4, d)
    return force, transposed @ moved


def _one_dilatation(section: Section, f: Array, lag: Array) -> tuple[Array, Array]:
    """K/2 (mean J - 1)^2 on the element's mean volume change (Nagtegaal et al. 1974; the mean
    dilatation method of Simo, Taylor and Pister 1985 with a constant pressure)."""
    cells = section.cells
    stress, tangent, j, cofactor = isochoric(f, section.shear[:, None])
    area = cells.weight.sum(axis=1)
    mean = (j * cells.weight).sum(axis=1) / area
    pressure = section.bulk * (mean - 1)
    stress = stress + pressure[:, None, None] * cofactor
    foreseen = pressure - section.bulk * (lag * cells.weight).sum(axis=1) / area
    tangent = tangent + foreseen[:, None, None, None] * cofactor_tangent()
    force, stiffness = _integrate(cells.operator, cells.weight, stress, tangent)
    swell = np.einsum("mq,mqv,mqvd->md", cells.weight, cofactor, cells.operator, optimize=True)
    stiffness += (section.bulk / area)[:, None, None] * swell[:, :, None] * swell[:, None, :]
    return force, stiffness


def hourglass_stiffness(section: Section) -> Array:
    """Stiffness (m,) [Pa] that holds each pattern (Flanagan and Belytschko 1981, eq. 59)."""
    cells = section.cells
    gradient = cells.operator[:, 0, :2, ::2]
    size = (gradient**2).sum(axis=(1, 2)) * cells.weight[:, 0]
    # the shear modulus, not the bulk: a stiffness by the bulk would lock near nu = 0.5
    return np.asarray(HOURGLASS * 4 * section.shear * size)


def _hold_hourglass(section: Section, u: Array, force: Array, tangent: Array) -> None:
    """Add the hourglass forces and their constant stiffness in place."""
    gamma = section.cells.hourglass
    assert gamma is not None
    stiffness = hourglass_stiffness(section)
    amplitude = np.einsum("mk,mki->mi", gamma, u[section.cells.nodes])
    for axis in (0, 1):
        force[:, axis::2] += (stiffness * amplitude[:, axis])[:, None] * gamma
        tangent[:, axis::2, axis::2] += (
            stiffness[:, None, None] * gamma[:, :, None] * gamma[:, None, :]
        )
