"""Every tangent against central differences of what it is the tangent of."""

import bodies
import numpy as np
import pytest
from lumen_area import lumen_area_m2

from sim_backend.fem.contact.finger_gaps import Finger
from sim_backend.fem.contact.lumen_self_contact import wall_gaps
from sim_backend.fem.continuation import continuation
from sim_backend.fem.elements import ELEMENTS
from sim_backend.fem.internal import forces_and_tangents
from sim_backend.fem.lumen import unit_pressure
from sim_backend.fem.model import build_section
from sim_backend.fem.newton import Load, unloaded
from sim_backend.fem.sensitivity import slopes
from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.scene_file import load_scene
from sim_backend.scene.waves import PA_PER_MMHG

PLANES = ("stress", "strain")


def bent(p):
    r, s = p.T
    return 1e-2 * np.column_stack([r + 0.15 * s * (1 - s), s + 0.1 * np.sin(np.pi * r)])


def ring(p):
    """A quarter of a tube, the lumen at r = 0."""
    radius, angle = 2e-3 + 1e-3 * p[:, 0], np.pi / 2 * p[:, 1]
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def moved(nodes, size=0.12):
    """Displacements that bend, shear and swell."""
    x, y = (nodes / np.ptp(nodes, axis=0)).T
    scale = size * np.ptp(nodes[:, 0])
    return scale * np.column_stack([x * y + 0.5 * np.sin(2 * y), 0.6 * x**2 - 0.4 * y])


def by_differences(function, u, dofs, step):
    columns = []
    for d in dofs:
        ahead, behind = u.copy().ravel(), u.copy().ravel()
        ahead[d] += step
        behind[d] -= step
        columns.append(function(ahead.reshape(-1, 2)) - function(behind.reshape(-1, 2)))
    return np.stack(columns, axis=-1) / (2 * step)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("element", ELEMENTS)
def test_cells(element, plane):
    body = bodies.body(bodies.grid(1, 1, bent), element, plane=plane, poisson=0.49)
    u = moved(body.nodes)
    wanted = by_differences(body.residual, u, range(body.section.size), 1e-8)
    tangent = body.stiffness(u)
    np.testing.assert_allclose(tangent, wanted, atol=2e-7 * np.abs(wanted).max())
    np.testing.assert_allclose(tangent, tangent.T, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("element", ELEMENTS)
def test_lumen_pressure(element, plane):
    """The follower load turns with the wall and, in plane stress, fades as the wall thins."""
    body = bodies.body(bodies.grid(2, 2, ring, pressed="left"), element, plane=plane, poisson=0.49)
    (sides,) = body.section.lumens
    u = moved(body.nodes, 0.2)
    for side in (0, len(sides.nodes) - 1):
        dofs = sides.dofs[side]
        wanted = by_differences(lambda v, s=side: unit_pressure(sides, v)[0][s], u, dofs, 1e-8)
        got = unit_pressure(sides, u)[1][side]
        np.testing.assert_allclose(got, wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("element", ELEMENTS)
def test_pressure_is_the_slope_of_the_lumens_area(element):
    """In plane strain p dA is the work of the pressure round a closed lumen."""
    section = _section(element, "strain")
    (sides,) = section.lumens
    u = moved(section.mesh.nodes, 0.02)
    force, _ = unit_pressure(sides, u)
    direction = moved(section.mesh.nodes[:, ::-1], 0.01)
    h = 1e-5
    swell = lumen_area_m2(sides, u + h * direction) - lumen_area_m2(sides, u - h * direction)
    work = float((force * direction.ravel()[sides.dofs]).sum())
    assert work == pytest.approx(swell / (2 * h), rel=1e-6)


@pytest.mark.parametrize("finger", [
    Finger(Profile(((0, 0),), 5e-3), 0, 0), Finger(Profile(((0, 0), (3e-3, 0)), 1e-3), 0, 0),
])  # fmt: skip
def test_finger_normals_turn_at_their_curvature(finger):
    rng = np.random.default_rng(3)
    points = rng.uniform([-4.9e-3, -1e-3], [4.9e-3, 6e-4], (200, 2))
    _, normal, curvature = finger.gap(points)
    h = 1e-9
    for axis in (0, 1):
        step = h * np.eye(2)[axis]
        (ahead, n1, _), (behind, n0, _) = finger.gap(points + step), finger.gap(points - step)
        np.testing.assert_allclose((ahead - behind) / (2 * h), normal[:, axis], atol=1e-4)
        turned = (n1 - n0) / (2 * h)
        along = np.eye(2)[axis] - normal[:, axis, None] * normal
        expected = curvature[:, None] * along
        smooth = np.abs(np.abs(points[:, 0]) - finger.profile.chord(0.0)) > 1e-6
        close = 1e-3 / finger.profile.radius
        np.testing.assert_allclose(turned[smooth], expected[smooth], atol=close)


def _section(element="T6", plane="stress"):
    scene = load_scene("TIHA").model_copy(update={"plane": plane})
    return build_section(scene, 0.030, depth_m=2.5e-3, size_m=1.5e-3, element=element)


def test_touching_finger():
    section = _section()
    u = np.zeros_like(section.mesh.nodes)
    u[section.mesh.surface, 1] = -0.5e-3
    penalty, multiplier = 3e6, np.linspace(5.0, 40.0, len(section.mesh.surface))

    def force(v):
        pair = section.contact_pairs(v, 1e-3)[0]
        start = section.contact_pairs(u, 1e-3)[0]
        total = np.zeros(section.size)
        pair.add_force(multiplier - penalty * (pair.gap - start.gap), total)
        return total

    pair = section.contact_pairs(u, 1e-3)[0]
    blocks = pair.blocks(multiplier, np.ones(len(multiplier), bool), penalty)
    near = np.flatnonzero(np.abs(section.mesh.nodes[section.mesh.surface, 0] - 0.03) < 3e-3)
    assert len(near) > 4
    for k in near[::3]:
        dofs = pair.dofs[k]
        wanted = by_differences(force, u, dofs, 1e-9)[dofs]
        np.testing.assert_allclose(-blocks[k], wanted, atol=1e-5 * penalty)


def test_walls_of_a_lumen():
    section = _section()
    (walls,) = section.walls
    rest = section.mesh.nodes[walls.nodes]
    middle = rest.mean(axis=0)
    flat = middle + (rest - middle) * [1.1, 0.02]  # nearly closed: normals are all but upright
    gap, gradient = wall_gaps(walls, flat)
    across = np.abs(flat[walls.upper, 0] - middle[0]) < 1.2e-3
    shift = np.zeros_like(flat)
    shift[walls.upper, 1] = 1e-6
    ahead, _ = wall_gaps(walls, flat + shift)
    np.testing.assert_allclose((ahead - gap)[across], (gradient @ shift.ravel())[across], rtol=0.02)
    assert np.all(gap > 0)


def test_neighbours_round_the_bend_do_not_meet():
    (walls,) = _section().walls
    rest = _section().mesh.nodes[walls.nodes]
    middle = rest.mean(axis=0)
    place = middle + (rest - middle) * [1.1, 0.5]
    low = np.unique([walls.lower, (walls.lower + 1) % len(rest)])
    ends = low[np.argsort(np.abs(place[low, 0] - middle[0]))[-2:]]
    place[ends, 0] += 0.06 * (middle[0] - place[ends, 0])
    gap, _ = wall_gaps(walls, place)
    assert np.all(gap > 0)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("mmhg, by, off", [
    (0.0, "pressure", 2e-4), (90.0, "pressure", 2e-4), (90.0, "depth", 1e-3),
])  # fmt: skip
def test_slope_of_a_solution(plane, mmhg, by, off):
    section, depth, p = _section(plane=plane), 2.5e-3, mmhg * PA_PER_MMHG
    deeper, more = (0.0, 40.0) if by == "pressure" else (1e-6, 0.0)
    (_, start, here) = continuation(
        section, unloaded(section), [Load(0.0, p), Load(1.3e-3, p), Load(depth, p)]
    )
    (ahead,) = continuation(section, here, [Load(depth + deeper, p + more)])
    (behind,) = continuation(section, here, [Load(depth - deeper, p - more)])
    assert all(
        np.array_equal(here.multiplier[0] > 0, other.multiplier[0] > 0) for other in (ahead, behind)
    ), "the contact must stay for this comparison"
    slope = slopes(section, here)[by == "pressure"]
    twice = 2 * (deeper + more)
    assert slope.force == pytest.approx(
        (ahead.force_n_per_m - behind.force_n_per_m) / twice, rel=off
    )
    moved = (ahead.displacement - behind.displacement) / twice
    np.testing.assert_allclose(slope.displacement, moved, atol=1e-3 * np.abs(moved).max())
    assert start.force_n_per_m < here.force_n_per_m


def test_a_solution_balances_itself():
    section = _section(plane="strain")  # in plane stress uneven thinning leaves a net lift
    (solved,) = continuation(section, unloaded(section), [Load(0.5e-3, 40 * PA_PER_MMHG)])
    force, _ = forces_and_tangents(section, solved.displacement)
    total = np.zeros(section.size)
    np.add.at(total, section.cells.dofs, force)
    for sides in section.lumens:
        unit, _ = unit_pressure(sides, solved.displacement)
        np.add.at(total, sides.dofs, -40 * PA_PER_MMHG * unit)
    by_support = total[section.fixed].sum()
    assert by_support == pytest.approx(solved.force_n_per_m, rel=1e-4)
    inside = np.setdiff1d(
        np.arange(section.size),
        np.concatenate([section.fixed, section.sliding.dofs[0], bodies.dofs(section.mesh.surface)]),
    )
    assert np.abs(total[inside]).max() < 1e-4 * solved.force_n_per_m
