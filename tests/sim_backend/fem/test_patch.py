"""Patch tests on distorted meshes with curved outlines; rigid motion; hourglass modes."""

import bodies
import numpy as np
import pytest

from sim_backend.fem.elements import ELEMENTS
from sim_backend.fem.internal import deformation
from sim_backend.fem.material import moduli, plane_strain, plane_stress

STRETCH = np.array([[1.15, 0.2], [-0.08, 0.9]])
PLANES = ("stress", "strain")


def curved(p):
    """A quarter-ring-like outline: all four sides bent."""
    r, s = p.T
    return 1e-2 * np.column_stack([r + 0.12 * s * (1 - s) * 4, s + 0.1 * np.sin(np.pi * r)])


def straight(p):
    r, s = p.T
    return 1e-2 * np.column_stack([r + 0.3 * s, 0.8 * s + 0.1 * r * s])


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("shape", [straight, curved])
def test_patch(element, plane, shape):
    mesh = bodies.grid(3, 3, shape, wild=0.12)
    body = bodies.body(mesh, element, plane=plane, poisson=0.49)
    linear = body.nodes @ (STRETCH - np.eye(2)).T
    edge = bodies.outline(body.section.mesh)
    inner = np.setdiff1d(np.arange(len(linear)), edge)
    start = linear.copy()
    start[inner] += np.random.default_rng(2).uniform(-1, 1, (len(inner), 2)) * 1e-5
    start = body.solve(bodies.dofs(edge), start, np.zeros(body.section.size))
    np.testing.assert_allclose(start, linear, atol=1e-9 * np.abs(linear).max())
    f = deformation(body.section, start)
    np.testing.assert_allclose(f - STRETCH.ravel(), 0, atol=1e-9)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("element", ELEMENTS)
def test_even_stress_meets_its_tractions(element, plane):
    """Forces on the outline of a patch are the stress times the outline's normals."""
    body = bodies.body(bodies.grid(3, 3, curved, wild=0.1), element, plane=plane)
    linear = body.nodes @ (STRETCH - np.eye(2)).T
    law = plane_stress if plane == "stress" else plane_strain
    g, k = moduli(50e3, 0.45)
    p = law(STRETCH.reshape(1, 4), np.full(1, g), np.full(1, k)).stress.reshape(2, 2)
    forces = body.residual(linear).reshape(-1, 2)
    inner = np.setdiff1d(np.arange(len(forces)), bodies.outline(body.section.mesh))
    assert np.abs(forces[inner]).max() < 1e-9 * np.abs(forces).max()
    # sum of x_j F_i over the nodes is the volume integral of P_ij
    area = body.section.cells.weight.sum()
    np.testing.assert_allclose(forces.T @ body.nodes, p * area, rtol=1e-9)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("degrees", [1.0, 37.0, 180.0])
def test_turning_a_body_turns_its_forces(element, plane, degrees):
    """F(R u) = R F(u), and no force for a rigid turn alone: also with hourglass control."""
    body = bodies.body(bodies.grid(3, 2, curved, wild=0.1), element, plane=plane)
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    rigid = body.nodes @ turn.T - body.nodes + [3e-3, -1e-3]
    largest = np.abs(body.residual(1e-1 * body.nodes)).max()
    assert np.abs(body.residual(rigid)).max() < 1e-9 * largest
    bent = 0.1 * body.nodes[:, ::-1] * (1 + 20 * body.nodes)
    turned = (body.nodes + bent) @ turn.T - body.nodes
    before = body.residual(bent).reshape(-1, 2)
    after = body.residual(turned).reshape(-1, 2)
    np.testing.assert_allclose(after, before @ turn.T, atol=2e-9 * np.abs(before).max())


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("element", ELEMENTS)
def test_only_rigid_motion_is_free(element, plane):
    body = bodies.body(bodies.grid(2, 2, straight, wild=0.1), element, plane=plane)
    k = body.stiffness(np.zeros_like(body.nodes))
    np.testing.assert_allclose(k, k.T, atol=1e-9 * np.abs(k).max())
    values = np.linalg.eigvalsh(k)
    assert np.all(np.abs(values[:3]) < 1e-9 * values[-1])
    assert values[3] > 1e-5 * values[-1]
