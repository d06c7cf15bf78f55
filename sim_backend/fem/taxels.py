"""The vertical force on each taxel: the contact's traction over the taxel's area.

A node's contact force is the traction weighted by the node's shape function. Over the integral of
that function it is the node's traction, and the elements' own shape functions carry it between the
nodes: so the traction's integral is the finger's force to rounding, on any mesh. (With straight
lines between the nodes a thousandth of the force is lost, and a taxel at the contact's edge is off
by twice as much.) Each side is cut into `PARTS`, the traction is integrated over each of them, and
each is shared among the taxels that it lies over. A skin passes its pressure straight on, as an
elastic foundation does.
"""

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.elements import q4
from sim_backend.fem.newton import Solution, as_solved, pairs_of
from sim_backend.fem.section import Section
from sim_backend.fem.solid.body import SolidBody

PARTS = 8
"""Parts of an element's side: of TIHA, 1.5 mm deep, taxels change by 2e-6 of the largest to 32."""
TURN = 360
"""Parts of a turn about a round finger's axis."""
_GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)


def section_taxels_n(
    section: Section, solution: Solution, across_m: Array, along_m: Array, length_m: float
) -> Array:
    """Force (rows, columns) [N] between edges across and along [m] from the finger's middle, each
    way; a section's is the same all along the finger, ``length_m``, if it is not turned."""
    if section.cells.hoop is not None:
        return _turned_taxels_n(section, solution, across_m, along_m)
    x, wide, force = _along_surface(section, solution)
    columns = force @ _shared(x - section.finger.x, wide, across_m)
    rows = length_m * _shared(np.zeros(1), np.array([length_m]), along_m)[0]
    return np.asarray(np.outer(rows, columns))


def _turned_taxels_n(
    section: Section, solution: Solution, across_m: Array, along_m: Array
) -> Array:
    """Of a section turned about x = 0. Its profile is scaled to the solution's force, which may be
    that between two blocks."""
    r, wide, force = _along_surface(section, solution)
    force = force * solution.force / force.sum()
    angle = 2 * np.pi * (np.arange(TURN) + 0.5) / TURN
    each = np.repeat(force / TURN, TURN)
    size = np.repeat(np.sqrt(wide * r * 2 * np.pi / TURN), TURN)  # as large a square
    columns = _shared(np.outer(r, np.cos(angle)).ravel(), size, across_m)
    rows = _shared(np.outer(r, np.sin(angle)).ravel(), size, along_m)
    return np.asarray(rows.T @ (each[:, None] * columns))


def solid_taxels_n(
    body: SolidBody, solution: Solution, across_m: Array, along_m: Array, _length_m: float
) -> Array:
    """Force (rows, columns) [N] between edges across and along, under a solid's finger."""
    nodes = body.wedges.nodes
    section, planes = body.prism
    on_top = body.surface.reshape(len(planes), -1)
    on_top = on_top[:, np.argsort(section[on_top[0], 0])]
    number = np.zeros(len(nodes), dtype=np.int64)
    number[body.surface] = np.arange(len(body.surface))
    faces = np.stack(
        [on_top[a : a + len(planes) - 2 : 2, b : on_top.shape[1] - 2 + b : 2]
         for a in range(3) for b in range(3)], axis=-1,
    ).reshape(-1, 9)  # fmt: skip
    moved = nodes + solution.displacement
    vertical = _vertical(body, solution)
    value, ends = _line(quadratic=True)
    shape = np.einsum("pqa,rsb->prqsab", value, value).reshape(PARTS, PARTS, 4, 9)
    flat = nodes[faces][:, :, [0, 2]]
    corners = flat[:, [0, 2, 6, 8]]  # of sides that are straight seen from above
    long = (corners[:, 2] - corners[:, 0] + corners[:, 3] - corners[:, 1])[:, 1] / 2
    wide = (corners[:, 1] - corners[:, 0] + corners[:, 3] - corners[:, 2])[:, 0] / 2
    measure = long * wide / (PARTS**2 * 4)
    share = np.bincount(number[faces].ravel(), np.outer(measure, shape.sum(axis=(0, 1, 2))).ravel())
    touched = (vertical[number[faces]] != 0).any(axis=1)
    faces, measure = faces[touched], measure[touched]
    traction = (vertical / share)[number[faces]]
    force = np.einsum("f,prqn,fn->fpr", measure, shape, traction, optimize=True)
    grid = np.einsum("pa,rb->prab", ends, ends).reshape(PARTS + 1, PARTS + 1, 9)
    place = np.einsum("prn,fni->fpri", grid, moved[faces][:, :, [0, 2]], optimize=True)
    across, along = place[..., 0], place[..., 1]
    across = (across[:, 1:] + across[:, :-1]) / 2
    along = (along[:, :, 1:] + along[:, :, :-1]) / 2
    x, dx = (across[..., 1:] + across[..., :-1]) / 2, np.diff(across, axis=2)
    z, dz = (along[:, 1:] + along[:, :-1]) / 2, np.diff(along, axis=1)
    columns = _shared((x - body.finger.under_m[0]).ravel(), dx.ravel(), across_m)
    found = 0.0
    for side in (1, -1) if body.share < 1 else (1,):
        rows = _shared(side * z.ravel(), dz.ravel(), along_m)
        found = found + rows.T @ (force.ravel()[:, None] * columns)
    return np.asarray(found)


def _along_surface(section: Section, solution: Solution) -> tuple[Array, Array, Array]:
    """Middle and width (n,) [m] of each part of the surface, deformed, and the force on it."""
    mesh, cells = section.mesh, section.cells
    vertical = _vertical(section, solution)
    sides = _sides(section)
    value, ends = _line(quadratic=cells.shape is not q4)
    at_rest = mesh.nodes[mesh.surface]
    length = np.hypot(*np.diff(at_rest[sides], axis=1).T).sum(axis=0)
    measure = np.broadcast_to(length[:, None, None] / (2 * PARTS), (len(sides), PARTS, 2))
    if cells.hoop is not None:
        measure = measure * 2 * np.pi * np.einsum("pqn,kn->kpq", value, at_rest[sides, 0])
    weight = np.einsum("kpq,pqn->kn", measure, value)
    share = np.bincount(sides.ravel(), weight.ravel(), minlength=len(at_rest))
    carries = share > 1e-9 * share.max()  # the node on an axis does not
    traction = np.where(carries, vertical / np.where(carries, share, 1.0), 0.0)
    if not carries[0]:
        traction[0] = (4 * traction[1] - traction[2]) / 3  # it is even about the axis
    force = np.einsum("kpq,pqn,kn->kp", measure, value, traction[sides])
    x = (at_rest + solution.displacement[mesh.surface])[sides, 0] @ ends.T
    return ((x[:, 1:] + x[:, :-1]) / 2).ravel(), np.diff(x, axis=1).ravel(), force.ravel()


def _vertical(body: Section | SolidBody, solution: Solution) -> Array:
    """The finger's force on each node of the surface (s,), downwards."""
    finger, *_ = pairs_of(as_solved(body, solution), solution.load, solution)
    return np.asarray(-solution.multiplier[0] * finger.gradient[:, 1])


def _sides(section: Section) -> Ints:
    """The surface's sides as numbers of its nodes from left to right, (k, 2) or (k, 3)."""
    count = len(section.mesh.surface)
    if section.cells.shape is q4:
        return np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    corners = 3 if section.cells.nodes.shape[1] == 6 else 4
    middle = np.flatnonzero(np.isin(section.mesh.surface, section.cells.nodes[:, corners:]))
    middle = middle[(middle > 0) & (middle < count - 1)]
    return np.stack([middle - 1, middle, middle + 1], axis=1)


def _line(*, quadratic: bool) -> tuple[Array, Array]:
    """Shape functions of a side at two Gauss points of each part (p, 2, n), and at the parts' ends
    (p + 1, n)."""
    step = np.linspace(0.0, 1.0, PARTS + 1)

    def shape(t: Array) -> Array:
        if not quadratic:
            return np.stack([1 - t, t], axis=-1)
        return np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=-1)

    return shape(step[:-1, None] + _GAUSS / PARTS), shape(step)


def _shared(x: Array, wide: Array, edges_m: Array) -> Array:
    """Shares (n, k) of parts about ``x`` (n,), so ``wide``, between each two edges (k + 1,)."""
    size = np.maximum(np.abs(wide), 1e-12)[:, None]
    return np.diff(np.clip((edges_m - x[:, None]) / size + 0.5, 0.0, 1.0), axis=1)
