"""A manufactured solution at finite strain: every element converges at its order."""

import bodies
import numpy as np
import pytest

from sim_backend.fem.elements import gradients
from sim_backend.fem.material import moduli, plane_strain, plane_stress

SIZE = 1e-2
LAWS = {"stress": plane_stress, "strain": plane_strain}
# Rates of displacement (L2) and of its gradient (H1). Q8R: serendipity shapes lose an order on
# quadrilaterals that stay trapezoids as they shrink (Arnold, Boffi and Falk 2002). T6M in plane
# strain: a constant pressure holds quadratic displacements back to first order (Boffi, Brezzi and
# Fortin 2013, sec. 8.4.3); in plane stress it is T6.
ORDER = {"T6": (3, 2), "T6M": (2, 1), "Q4": (2, 1), "Q4R": (2, 1), "Q4M": (2, 1), "Q8R": (2, 1)}


def bulge(p):
    """A square with two bent sides."""
    r, s = p.T
    return SIZE * np.column_stack([r + 0.15 * s * (1 - s), s + 0.1 * np.sin(np.pi * r)])


def exact(x):
    """Displacement (n, 2), its gradient (n, 2, 2) and second derivatives (n, 2, 2, 2)."""
    a, b = x.T / SIZE
    w = 1.7
    u = 0.08 * SIZE * np.stack([np.sin(w * a) * np.cos(b), a * b + 0.5 * np.cos(w * b)], 1)
    g = np.empty((len(x), 2, 2))
    g[:, 0, 0], g[:, 0, 1] = w * np.cos(w * a) * np.cos(b), -np.sin(w * a) * np.sin(b)
    g[:, 1, 0], g[:, 1, 1] = b, a - 0.5 * w * np.sin(w * b)
    h = np.zeros((len(x), 2, 2, 2))
    h[:, 0, 0, 0] = -w * w * np.sin(w * a) * np.cos(b)
    h[:, 0, 0, 1] = h[:, 0, 1, 0] = -w * np.cos(w * a) * np.sin(b)
    h[:, 0, 1, 1] = -np.sin(w * a) * np.cos(b)
    h[:, 1, 0, 1] = h[:, 1, 1, 0] = 1
    h[:, 1, 1, 1] = -0.5 * w * w * np.cos(w * b)
    return u, 0.08 * g, 0.08 / SIZE * h


def isochoric(x):
    """As `exact`: a whirl so small that it keeps every volume."""
    a, b = x.T / SIZE
    size = 1e-5
    ca, sa, cb, sb = np.cos(2 * a), np.sin(2 * a), np.cos(b), np.sin(b)
    u = size * SIZE * np.stack([sa * cb, -2 * ca * sb], 1)
    g = size * np.stack(
        [np.stack([2 * ca * cb, -sa * sb], 1), np.stack([4 * sa * sb, -2 * ca * cb], 1)], 1
    )
    h = np.empty((len(x), 2, 2, 2))
    h[:, 0, 0, 0], h[:, 0, 1, 1] = -4 * sa * cb, -sa * cb
    h[:, 0, 0, 1] = h[:, 0, 1, 0] = -2 * ca * sb
    h[:, 1, 0, 0], h[:, 1, 1, 1] = 8 * ca * sb, 2 * ca * sb
    h[:, 1, 0, 1] = h[:, 1, 1, 0] = 4 * sa * cb
    return u, g, size / SIZE * h


def body_force(x, truth, plane, poisson):
    """-Div P(F(X)) by the chain rule: (n, 2) [N/m3]."""
    _, g, h = truth(x)
    f = (g + np.eye(2)).reshape(-1, 4)
    shear, bulk = moduli(50e3, poisson)
    tangent = LAWS[plane](f, np.full(len(x), shear), np.full(len(x), bulk)).tangent
    return -np.einsum("niJkL,nkLJ->ni", tangent.reshape(-1, 2, 2, 2, 2), h)


def fine_rule(quad):
    """A rule of degree 7 or more: (q, 2) points and (q,) weights."""
    at, weight = np.polynomial.legendre.leggauss(5)
    r, s = (v.ravel() for v in np.meshgrid(at, at, indexing="ij"))
    w = np.outer(weight, weight).ravel()
    if quad:
        return np.column_stack([r, s]), w
    a, b = (1 + r) / 2, (1 + s) / 2
    return np.column_stack([a, b * (1 - a)]), w * (1 - a) / 4


def errors(element, plane, n, poisson, truth=exact):
    body = bodies.body(bodies.grid(n, n, bulge), element, plane=plane, poisson=poisson)
    section = body.section
    cells, shape = section.cells.nodes, section.cells.shape
    points, weight = fine_rule(cells.shape[1] != 6)
    value, slope = shape(points)
    gradient, det = gradients(body.nodes, cells, slope)
    place = np.einsum("qk,mki->mqi", value, body.nodes[cells])
    m, q, _ = place.shape
    b = body_force(place.reshape(-1, 2), truth, plane, poisson).reshape(m, q, 2)
    each = np.einsum("q,mq,qk,mqi->mki", weight, det, value, b)
    load = np.bincount(section.cells.dofs.ravel(), each.ravel(), section.size)
    start = truth(body.nodes)[0]
    u = body.solve(bodies.dofs(bodies.outline(section.mesh)), start, load)
    want_u, want_g, _ = truth(place.reshape(-1, 2))
    du = np.einsum("qk,mki->mqi", value, u[cells]) - want_u.reshape(m, q, 2)
    dg = np.einsum("mqak,mki->mqia", gradient, u[cells]) - want_g.reshape(m, q, 2, 2)
    dv = det * weight
    return np.sqrt([(dv * (du**2).sum(-1)).sum(), (dv * (dg**2).sum((-1, -2))).sum()])


@pytest.mark.parametrize(("plane", "poisson"), [("stress", 0.49), ("strain", 0.3)])
@pytest.mark.parametrize("element", ORDER)
def test_order(element, plane, poisson):
    coarse, fine = (errors(element, plane, n, poisson) for n in (6, 12))
    rates = np.log2(coarse / fine)
    wanted = np.array((3, 2) if element == "T6M" and plane == "stress" else ORDER[element])
    assert np.all(rates > wanted - 0.2), f"rates {rates}, wanted {wanted}"


@pytest.mark.parametrize("element", ["T6M", "Q4M", "Q4R", "Q8R"])
def test_order_holds_near_incompressibility(element):
    coarse, fine = (errors(element, "strain", n, 0.49999, isochoric)[0] for n in (6, 12))
    assert np.log2(coarse / fine) > 1.8
