"""Small strain: the body is condensed once to the nodes that a finger may touch.

Linear elasticity (the tangent at rest of the finite-strain law) with exact contact: finger
normals turn with the deformed surface. One factorisation serves every depth, pressure and, on a
mesh that is fine all along the surface, every station (`benchmarks/speed_accuracy.py`). At 2.5 mm
it misses 11 % of the force and two thirds of a deep vessel's pulse; see the speed-accuracy chart
before choosing it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.assembly import gather
from sim_backend.fem.contact.finger_gaps import Finger
from sim_backend.fem.internal import forces_and_tangents, smallest_area_ratio
from sim_backend.fem.lumen import unit_pressure
from sim_backend.fem.model import Grading, build_section
from sim_backend.fem.newton import MIN_VOLUME_RATIO, CannotSolve, Load, Solution
from sim_backend.fem.section import Section
from sim_backend.scene.scene_file import Scene

MAX_ITERATIONS = 60
CLOSED_M = 1e-9


@dataclass(frozen=True)
class Condensed:
    """``candidates`` (c,) index the section's surface; unit forces there, [x0, y0, x1, ...], move
    the whole body by ``compliance_columns`` (2n, 2c) [m/(N/m)], and 1 Pa in the lumens by
    ``pressure_response`` (2n,)."""

    section: Section
    candidates: Ints
    compliance_columns: Array
    pressure_response: Array

    @property
    def compliance(self) -> Array:
        """(2c, 2c): displacements of the candidates by forces on them."""
        return self.compliance_columns[_dofs(self.section.mesh.surface[self.candidates])]


def condense(section: Section, candidates: Ints) -> Condensed:
    """Factorise once and keep what forces on ``candidates`` and lumen pressure do."""
    still = np.zeros_like(section.mesh.nodes)
    _, tangent = forces_and_tangents(section, still)
    matrices = [tangent]
    inflate = np.zeros(section.size)
    for sides in section.lumens:
        unit, _ = unit_pressure(sides, still)
        inflate += gather(section.size, sides.dofs, unit)
        matrices.append(np.zeros((len(sides.dofs), sides.dofs.shape[1], sides.dofs.shape[1])))
    surface, resting = section.mesh.surface, section.mesh.resting
    matrices += [section.sliding.block]
    matrices += [np.zeros((len(surface), 2, 2)), np.zeros((len(resting), 2, 2))]
    factors = section.assembly.factor(matrices)
    dofs = _dofs(surface[candidates])
    loads = np.zeros((section.size, len(dofs) + 1))
    loads[dofs, np.arange(len(dofs))] = 1.0
    loads[:, -1] = inflate
    moved = factors.solve(loads)
    return Condensed(section, candidates, moved[:, :-1], moved[:, -1])


def solve_contact(body: Condensed, finger: Finger, load: Load) -> Solution:
    """The contact that a finger ``load.depth_m`` below ``finger`` makes. Raises `CannotSolve`.

    Primal-dual active set on the candidates; the normals are those where the nodes have moved to.
    """
    finger = finger.lowered_to(finger.y - load.depth_m)
    nodes = body.section.mesh.surface[body.candidates]
    soft = finger.skin_m_per_pa / body.section.surface_share_m[body.candidates]
    rest = body.section.mesh.nodes[nodes]
    compliance = body.compliance
    inflated = load.pressure_pa * body.pressure_response[_dofs(nodes)].reshape(-1, 2)
    stiffness = body.section.tissue_pa
    u, multiplier = inflated.copy(), np.zeros(len(nodes))
    before = np.zeros(len(nodes), dtype=bool)
    for iteration in range(1, MAX_ITERATIONS + 1):
        gap, normal, _ = finger.gap(rest + u)
        open_m = gap + soft * multiplier
        active = multiplier > stiffness * open_m
        if np.array_equal(active, before) and np.abs(open_m[active]).max(initial=0.0) < CLOSED_M:
            return _solution(body, normal, multiplier, load, iteration)
        on = np.flatnonzero(active)
        multiplier = np.zeros(len(nodes))
        if len(on):
            pairs = np.stack([2 * on, 2 * on + 1], axis=1).ravel()
            by = normal[on, :, None] * np.eye(len(on))[:, None, :]
            by = by.reshape(2 * len(on), len(on))
            along_normals = by.T @ compliance[np.ix_(pairs, pairs)] @ by + np.diag(soft[on])
            wanted = -gap[on] + np.einsum("ki,ki->k", normal[on], u[on] - inflated[on])
            multiplier[on] = np.linalg.solve(along_normals, wanted)
        force = (multiplier[:, None] * normal).ravel()
        u = inflated + (compliance @ force).reshape(-1, 2)
        before = active
    raise CannotSolve(
        "small strain",
        f"the contact is not found {1e3 * load.depth_m:.3g} mm deep: the surface turns too far "
        "for small strain. Press less deep or take the finite-strain model.",
    )


def solve_small(
    scene: Scene,
    x_m: float,
    depth_m: float,
    pressures_pa: Sequence[float],
    size_m: float,
    element: str | None = None,
    *,
    grading: Grading | None = None,
) -> tuple[Section, list[Solution]]:
    """As `solve_finite`, at small strain."""
    section = build_section(
        scene, x_m, depth_m=depth_m, size_m=size_m, element=element, grading=grading
    )
    body = condense(section, candidates_near(section, x_m, depth_m))
    solutions = [solve_contact(body, section.finger, Load(depth_m, p)) for p in pressures_pa]
    for one in solutions:
        _refuse_nonsense(section, one)
    return section, solutions


def _refuse_nonsense(section: Section, solution: Solution) -> None:
    """Small strain has an answer to everything; not every one is a body. Raises `CannotSolve`."""
    if solution.load.depth_m > 0 and not solution.multiplier[0].any():
        raise CannotSolve(
            "small strain",
            f"the finger touches no node of the mesh {1e3 * solution.load.depth_m:.3g} mm deep: "
            "its lowest point is between two. Press deeper.",
        )
    ratio, _ = smallest_area_ratio(section, solution.displacement)
    if ratio > MIN_VOLUME_RATIO and (solution.force_n_per_m > 0 or solution.load.depth_m <= 0):
        return
    raise CannotSolve(
        "small strain",
        f"small strain turns tissue inside out {1e3 * solution.load.depth_m:.3g} mm deep (det F = "
        f"{ratio:.2g}). Press less deep or take the finite-strain model.",
    )


def candidates_near(section: Section, x_m: float, depth_m: float) -> Ints:
    """Surface nodes that a finger at ``x_m`` may touch ``depth_m`` deep."""
    x = section.mesh.nodes[section.mesh.surface, 0]
    return np.flatnonzero(np.abs(x - x_m) <= 1.1 * section.finger.profile.arc(depth_m))


def _solution(
    body: Condensed, normal: Array, multiplier: Array, load: Load, iteration: int
) -> Solution:
    force = (multiplier[:, None] * normal).ravel()
    u = load.pressure_pa * body.pressure_response + body.compliance_columns @ force
    every = np.zeros(len(body.section.mesh.surface))
    every[body.candidates] = multiplier
    return Solution(load, u.reshape(-1, 2), (every,), float(-force[1::2].sum()), iteration)


def _dofs(nodes: Ints) -> Ints:
    return np.stack([2 * nodes, 2 * nodes + 1], axis=1).ravel()
