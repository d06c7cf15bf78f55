"""Wedges converge at their order towards a displacement that is in balance without forces."""

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from sim_backend.arrays import Array, Ints
from sim_backend.fem.elements import t6
from sim_backend.fem.solid.forces import tangents
from sim_backend.fem.solid.prism import Wedges, extrude, line, wedges_of

SIZE_M = 1e-2
RATES = np.array([np.sqrt(5.0), 2.0, 1.0])
POINTS = np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]])
HEIGHTS = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])


def exact(place: Array) -> tuple[Array, Array]:
    """The gradient u (..., 3) [m] of a harmonic function, and its own (..., 3, 3).

    Without a change of volume and with div grad u = 0 it is in balance in any linear elastic body.
    """
    a, b, c = np.moveaxis(RATES * place / SIZE_M, -1, 0)
    grow, cos_b, sin_b, cos_c, sin_c = np.exp(a), np.cos(b), np.sin(b), np.cos(c), np.sin(c)
    u = np.stack([cos_b * cos_c, -sin_b * cos_c, -cos_b * sin_c], axis=-1)
    slope = np.stack([
        np.stack([cos_b * cos_c, -sin_b * cos_c, -cos_b * sin_c], axis=-1),
        np.stack([-sin_b * cos_c, -cos_b * cos_c, sin_b * sin_c], axis=-1),
        np.stack([-cos_b * sin_c, sin_b * sin_c, -cos_b * cos_c], axis=-1),
    ], axis=-2)  # fmt: skip
    tiny = 1e-7  # so small that the body is linear
    grown = tiny * grow[..., None] * RATES
    return SIZE_M * grown * u, (grown[..., None] * slope) * RATES


def box(count: int) -> Wedges:
    """A cube of ``count`` layers of twice as many wedges to a side, bent inside."""
    s = np.linspace(0.0, 1.0, 2 * count + 1)
    x, y = (each.ravel() for each in np.meshgrid(s, s, indexing="ij"))
    bend = 0.06 * np.sin(np.pi * x) * np.sin(np.pi * y)
    number = np.arange(x.size).reshape(2 * count + 1, -1)

    def triangles(corners: list[tuple[int, int]]) -> Ints:
        at = [*corners, *((p + q) / 2 for p, q in zip(
            np.array(corners), np.roll(corners, -1, axis=0), strict=True))]  # fmt: skip
        steps = 2 * np.arange(count)
        return np.stack([
            number[np.ix_(steps + int(i), steps + int(j))].ravel() for i, j in np.array(at)
        ], axis=1)  # fmt: skip

    cells = np.vstack([triangles([(0, 0), (2, 0), (0, 2)]), triangles([(2, 2), (0, 2), (2, 0)])])
    section = SIZE_M * np.column_stack([x + bend, y - bend])
    nodes, wedges = extrude(section, cells, SIZE_M * np.linspace(0.0, 1.0, count + 1))
    return wedges_of(nodes, wedges.reshape(-1, 18))


def errors(count: int, bulk_over_shear: float) -> Array:
    """Of displacement and of its gradient: root mean squares over the cube."""
    body = box(count)
    shear = np.full(len(body.cells), 1e4)
    blocks = tangents(body, shear, bulk_over_shear * shear, np.zeros_like(body.nodes))
    rows = np.repeat(body.dofs[:, :, None], 54, axis=2)
    whole = coo_matrix(
        (blocks.astype(float).ravel(), (rows.ravel(), np.swapaxes(rows, 1, 2).ravel()))
    ).tocsr()
    u, _ = exact(body.nodes)
    outside = (body.nodes.min(axis=1) < 1e-9) | (body.nodes.max(axis=1) > SIZE_M - 1e-9)
    free = np.flatnonzero(np.repeat(~outside, 3))
    found = np.where(np.repeat(outside, 3), u.ravel(), 0.0)
    found[free] = spsolve(whole[free][:, free].tocsc(), -(whole @ found)[free])
    moved = found.reshape(-1, 3)[body.cells]
    value = np.einsum("qa,qi->qai", line(np.repeat(HEIGHTS, 3))[0], t6(np.tile(POINTS, (3, 1)))[0])
    value = value.reshape(9, 18)
    wanted, slope = exact(value @ body.nodes[body.cells])
    off = ((value @ moved - wanted) ** 2).sum(axis=-1)
    off_slope = ((np.einsum("mki,mqkj->mqij", moved, body.gradient) - slope) ** 2).sum(axis=(2, 3))
    return np.sqrt([(body.weight * each).sum() for each in (off, off_slope)])


@pytest.mark.parametrize("bulk_over_shear", [1.0, 50.0])
def test_order(bulk_over_shear: float) -> None:
    """Third of displacement, second of its gradient, also at Poisson's ratio 0.49."""
    order, order_of_slope = np.log2(errors(3, bulk_over_shear) / errors(6, bulk_over_shear))
    assert order == pytest.approx(3.0, abs=0.15)
    assert order_of_slope == pytest.approx(2.0, abs=0.15)
