"""Presses of TIHA in nearly incompressible plane strain, by a method that shares nothing with ours.

    python benchmarks/taylor_hood.py [TABLE.json]

Displacements and pressures are separate fields: quadratic and linear triangles, the pressure
continuous within each material (Taylor and Hood 1973; Brezzi and Fortin 1991, sec. VI.6). They do
not lock, up to nu = 0.5. The mesh is a grid of half the section round the vessel; contact is held
at two Gauss points of each side by an augmented Lagrangian; six points integrate a triangle. Only
the energy is the same:

    W = G/2 (J^(-2/3) tr(F^T F) - 3) + p (J - 1) - p^2 / (2 K).

Forces of two meshes and their extrapolation are kept, and tests hold ours against them.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from sim_backend.arrays import Array, Ints

TABLE = Path(__file__).parents[1] / "tests" / "data" / "presses" / "taylor-hood.json"
POISSON = (0.49, 0.499, 0.4999)
PRESSURES_MMHG = (0.0, 80.0, 120.0)
PA_PER_MMHG = 133.322387415
DEPTH_M, FIRST_STEP = 2.5e-3, 0.04
WIDTH_M, HEIGHT_M, TISSUE_PA = 64e-3, 16.83e-3, 50e3
CENTRE_M, INNER_M, OUTER_M, WALL_PA = HEIGHT_M - 12.66e-3, 2.25e-3, 2.88e-3, 400e3
FINGER_M = 5e-3
SQUARE_M = 3.4e-3
"""Half the side of the square round the vessel whose points are joined to the vessel's by rays."""
LONGEST_M = 0.2e-3
"""Largest displacement in an iteration."""
MESHES = (10, 14)
"""Cells along half a side of the square."""
ORDER = 2.0
"""Of the extrapolation, which moves forces by 0.02 % from the finer mesh, at nu = 0.499."""

# six points of degree four (Dunavant 1985), over the unit triangle
_A, _B, _WA, _WB = 0.445948490915965, 0.091576213509771, 0.223381589678011, 0.109951743655322
POINTS = np.array([[_A, _A], [1 - 2 * _A, _A], [_A, 1 - 2 * _A],
                   [_B, _B], [1 - 2 * _B, _B], [_B, 1 - 2 * _B]])  # fmt: skip
WEIGHTS = np.array([_WA] * 3 + [_WB] * 3) / 2
SIDE_POINTS = np.array([-1.0, 1.0]) / np.sqrt(3)  # of weight 1 each
COFACTOR = np.array([[0, 0, 0, 1], [0, 0, -1, 0], [0, -1, 0, 0], [1, 0, 0, 0]], dtype=float)
"""Takes F as [F11, F12, F21, F22] to its cofactors."""


@dataclass(frozen=True)
class Grid:
    """``nodes`` (n, 2), six-node ``cells`` (m, 6), their Young's modulus (m,), and three-node
    sides: the surface from the middle outwards, the lumen from its top down."""

    nodes: Array
    cells: Ints
    modulus_pa: Array
    surface: Ints
    lumen: Ints


def graded(start: float, end: float, first: float, growth: float) -> Array:
    """From ``start`` to ``end``, cells that begin with ``first`` and grow."""
    sizes = [first]
    while sum(sizes) < abs(end - start):
        sizes.append(sizes[-1] * growth)
    return np.asarray(start + (end - start) * np.append(0, np.cumsum(sizes)) / sum(sizes))


def halves(line: Array) -> Array:
    """With the middles between."""
    return np.sort(np.concatenate([line, (line[1:] + line[:-1]) / 2]))


def make_grid(m: int) -> Grid:
    """Half of the section, x from its middle."""
    h = SQUARE_M / m
    side = np.linspace(-SQUARE_M, SQUARE_M, 2 * m + 1)
    near = np.arange(m + round(2e-3 / h) + 1) * h
    x = halves(np.concatenate([near, graded(near[-1], WIDTH_M / 2, h, 1.25)[1:]]))
    low, high = CENTRE_M - SQUARE_M, CENTRE_M + SQUARE_M
    below = np.linspace(0, low, max(2, round(low / h)) + 1)
    halfway = (high + HEIGHT_M) / 2
    above = np.concatenate([graded(high, halfway, h, 1.2), graded(HEIGHT_M, halfway, h / 2, 1.2)])
    y = halves(np.unique(np.round(np.concatenate([below, CENTRE_M + side, above]), 12)))
    lattices = []
    in_x, in_y = np.searchsorted(x, SQUARE_M - 1e-9), np.searchsorted(y, [low - 1e-9, high - 1e-9])
    for columns, rows in (
        (slice(None, in_x + 1), slice(None, in_y[0] + 1)),
        (slice(None, in_x + 1), slice(in_y[1], None)),
        (slice(in_x, None), slice(None)),
    ):
        lattices.append((np.stack(np.meshgrid(x[columns], y[rows], indexing="ij"), axis=-1),
                         TISSUE_PA))  # fmt: skip
    along = halves(np.linspace(0, 4 * m, 4 * m + 1)) / m  # round the square, from its top, down
    across = np.select([along < 1, along <= 3], [along, 1.0], 4 - along)
    up = np.select([along < 1, along <= 3], [1.0, 2 - along], -1.0)
    square = SQUARE_M * np.stack([across, up], axis=1)
    ray = square / np.hypot(*square.T)[:, None]
    centre = np.array([0.0, CENTRE_M])
    through = np.linspace(INNER_M, OUTER_M, 2 * max(2, m // 4) + 1)
    lattices.append((centre + through[:, None, None] * ray, WALL_PA))
    share = np.linspace(0, 1, 2 * max(2, m // 4) + 1)[:, None, None]
    lattices.append((centre + (1 - share) * OUTER_M * ray + share * square, TISSUE_PA))
    return _merged(lattices)


def _merged(lattices: list[tuple[Array, float]]) -> Grid:
    """Lattices (a, b, 2) of corners and mid-points, each of one material, as triangles."""
    points = np.concatenate([one.reshape(-1, 2) for one, _ in lattices])
    _, first, number = np.unique(np.round(points, 9), axis=0, return_index=True,
                                 return_inverse=True)  # fmt: skip
    nodes, cells, modulus, begin = points[first], [], [], 0
    for lattice, pa in lattices:
        a, b = lattice.shape[:2]
        local = number.ravel()[begin : begin + a * b].reshape(a, b)
        begin += a * b
        for i in range(0, a - 2, 2):
            for j in range(0, b - 2, 2):
                n = local[i : i + 3, j : j + 3]
                cells += [[n[0, 0], n[2, 0], n[2, 2], n[1, 0], n[2, 1], n[1, 1]],
                          [n[0, 0], n[2, 2], n[0, 2], n[1, 1], n[1, 2], n[0, 1]]]  # fmt: skip
                modulus += [pa, pa]
    cell = np.array(cells)
    corner = nodes[cell[:, :3]]
    edge = corner[:, 1:] - corner[:, :1]
    turned = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0] < 0
    cell[turned] = cell[turned][:, [0, 2, 1, 5, 4, 3]]
    top = np.flatnonzero(np.abs(nodes[:, 1] - HEIGHT_M) < 1e-10)
    top = top[np.argsort(nodes[top, 0])]
    away = nodes - [0, CENTRE_M]
    hole = np.flatnonzero(np.abs(np.hypot(*away.T) - INNER_M) < 1e-10)
    hole = hole[np.argsort(np.arctan2(away[hole, 0], away[hole, 1]))]
    sides = [np.stack([line[:-2:2], line[1:-1:2], line[2::2]], axis=1) for line in (top, hole)]
    return Grid(nodes, cell, np.array(modulus), *sides)


def quadratic(p: Array) -> Array:
    """Gradients (q, 6, 2) of the six-node triangle at ``p`` (q, 2)."""
    b, c = p.T
    a = 1 - b - c
    z = np.zeros_like(a)
    by_b = [1 - 4 * a, 4 * b - 1, z, 4 * (a - b), 4 * c, -4 * c]
    by_c = [1 - 4 * a, z, 4 * c - 1, -4 * b, 4 * b, 4 * (a - c)]
    return np.stack([np.stack(by_b, 1), np.stack(by_c, 1)], axis=2)


def on_side(s: Array) -> tuple[Array, Array]:
    """Values and slopes (q, 3) along a side at ``s`` (q,) in [-1, 1]; nodes first, middle, last."""
    value = np.stack([s * (s - 1) / 2, 1 - s**2, s * (s + 1) / 2], axis=1)
    return value, np.stack([s - 0.5, -2 * s, s + 0.5], axis=1)


class Problem:
    """Newton's method on displacements and pressures, with augmented contact."""

    def __init__(self, grid: Grid, poisson: float) -> None:
        self.grid, n = grid, len(grid.nodes)
        shear = grid.modulus_pa / (2 * (1 + poisson))
        self.bulk = grid.modulus_pa / (3 * (1 - 2 * poisson))
        self.shear = shear[:, None]
        # a corner has one pressure for each material that meets there
        key = 3 * grid.cells[:, :3] + (grid.modulus_pa > TISSUE_PA)[:, None]
        _, pressure = np.unique(key, return_inverse=True)
        self.pressure = 2 * n + pressure.reshape(-1, 3)
        self.size = int(self.pressure.max()) + 1
        self.dofs = np.stack([2 * grid.cells, 2 * grid.cells + 1], axis=2).reshape(-1, 12)
        reference = quadratic(POINTS)
        jacobian = np.einsum("qka,mki->mqia", reference, grid.nodes[grid.cells])
        slope = np.einsum("qka,mqai->mqki", reference, np.linalg.inv(jacobian))
        self.weight = np.linalg.det(jacobian) * WEIGHTS
        assert (self.weight > 0).all()
        self.to_f = np.zeros((*slope.shape[:2], 4, 12))
        for i in (0, 1):
            for j in (0, 1):
                self.to_f[:, :, 2 * i + j, i::2] = slope[..., j]
        self.linear = np.stack([1 - POINTS.sum(1), *POINTS.T], axis=1)  # (q, 3)
        x, y = grid.nodes.T
        middle, bottom = np.flatnonzero(np.abs(x) < 1e-10), np.flatnonzero(np.abs(y) < 1e-10)
        self.free = np.setdiff1d(np.arange(self.size), [*(2 * middle), *(2 * bottom + 1)])

    def body(self, z: Array) -> tuple[Array, list[tuple[Array, Ints, Ints]]]:
        """Residual, and tangent blocks with their rows and columns."""
        f = np.einsum("mqvd,md->mqv", self.to_f, z[self.dofs]) + np.array([1.0, 0, 0, 1.0])
        p = z[self.pressure] @ self.linear.T
        cofactor = f @ COFACTOR
        j = 0.5 * (f * cofactor).sum(-1)
        if (j <= 0).any():
            raise ArithmeticError("elements turned inside out")
        h = cofactor / j[..., None]
        i1 = (f**2).sum(-1) + 1
        g = self.shear * j ** (-2 / 3)
        iso = f - (i1 / 3)[..., None] * h
        stress = g[..., None] * iso + p[..., None] * cofactor
        # dF^-T = (its part that is linear in dF) / J - H (H : dF)
        by_f = np.eye(4) - 2 / 3 * (h[..., :, None] * f[..., None, :])
        by_f = by_f - 2 / 3 * iso[..., :, None] * h[..., None, :]
        d_h = COFACTOR / j[..., None, None] - h[..., :, None] * h[..., None, :]
        tangent = g[..., None, None] * (by_f - (i1 / 3)[..., None, None] * d_h)
        tangent = tangent + p[..., None, None] * COFACTOR
        w = self.weight
        force = np.einsum("mq,mqv,mqvd->md", w, stress, self.to_f, optimize=True)
        swell = np.einsum("mq,qa,mqa->ma", w, self.linear, (j - 1)[..., None] * np.ones(3))
        swell -= np.einsum("mq,qa,mq->ma", w, self.linear, p) / self.bulk[:, None]
        k_uu = np.einsum("mq,mqvd,mqvw,mqwe->mde", w, self.to_f, tangent, self.to_f, optimize=True)
        k_up = np.einsum("mq,mqv,mqvd,qa->mda", w, cofactor, self.to_f, self.linear, optimize=True)
        k_pp = -np.einsum("mq,qa,qb->mab", w, self.linear, self.linear) / self.bulk[:, None, None]
        residual = np.bincount(self.dofs.ravel(), force.ravel(), self.size)
        residual += np.bincount(self.pressure.ravel(), swell.ravel(), self.size)
        return residual, [
            (k_uu, self.dofs, self.dofs), (k_up, self.dofs, self.pressure),
            (np.swapaxes(k_up, 1, 2), self.pressure, self.dofs),
            (k_pp, self.pressure, self.pressure),
        ]  # fmt: skip

    def lumen(self, z: Array, pa: float) -> tuple[Array, tuple[Array, Ints, Ints]]:
        """Pressure on the deformed wall: forces and their tangent."""
        side = self.grid.lumen
        dofs = np.stack([2 * side, 2 * side + 1], axis=2).reshape(-1, 6)
        at = self.grid.nodes[side] + z[dofs].reshape(-1, 3, 2)
        gauss, weight = np.polynomial.legendre.leggauss(3)
        value, along = on_side(gauss)
        turn = np.array([[0.0, -1.0], [1.0, 0.0]])  # tangent to normal, walking clockwise
        normal = np.einsum("qk,ski->sqi", along, at) @ turn.T
        force = pa * np.einsum("q,qk,sqi->ski", weight, value, normal).reshape(-1, 6)
        block = pa * np.einsum("q,qk,ql,ij->kilj", weight, value, along, turn).reshape(6, 6)
        residual = -np.bincount(dofs.ravel(), force.ravel(), self.size)
        return residual, (np.repeat(-block[None], len(side), axis=0), dofs, dofs)

    def finger(
        self, z: Array, depth_m: float, held: Array, penalty: float
    ) -> tuple[Array, tuple[Array, Ints, Ints], Array, Array]:
        """Residual, tangent, contact pressure (s, 2) [Pa] and penetration where it presses."""
        side = self.grid.surface
        dofs = np.stack([2 * side, 2 * side + 1], axis=2).reshape(-1, 6)
        value, along = on_side(SIDE_POINTS)
        length = np.hypot(*np.einsum("qk,ski->isq", along, self.grid.nodes[side]))
        at = np.einsum("qk,ski->sqi", value, self.grid.nodes[side] + z[dofs].reshape(-1, 3, 2))
        away = at - [0.0, HEIGHT_M - depth_m + FINGER_M]
        far = np.hypot(*np.moveaxis(away, 2, 0))
        normal, gap = away / far[..., None], far - FINGER_M
        press = np.maximum(held - penalty * gap, 0.0)
        on = press > 0
        weight = length * press
        force = -np.einsum("sq,qk,sqi->ski", weight, value, normal).reshape(-1, 6)
        outer = normal[..., :, None] * normal[..., None, :]
        turning = (np.eye(2) - outer) / far[..., None, None]
        local = (length * on * penalty)[..., None, None] * outer
        local -= weight[..., None, None] * turning
        block = np.einsum("qk,ql,sqij->skilj", value, value, local).reshape(-1, 6, 6)
        residual = np.bincount(dofs.ravel(), force.ravel(), self.size)
        return residual, (block, dofs, dofs), press, np.where(on, gap, 0.0)

    def solve(self, z: Array, held: Array, depth_m: float, pa: float) -> tuple[Array, Array, float]:
        """Fields, contact pressures and the whole section's force [N/m] at the next load.

        Raises ArithmeticError where the step was too long.
        """
        penalty = 50 * TISSUE_PA / (SQUARE_M / 10)
        for _ in range(40):
            for _ in range(12):
                residual, blocks = self.body(z)
                push, inner = self.lumen(z, pa)
                touch, outer, press, _ = self.finger(z, depth_m, held, penalty)
                residual = (residual + push + touch)[self.free]
                whole = [*blocks, inner, outer]
                rows = np.concatenate([np.repeat(r, c.shape[1], 1).ravel() for _, r, c in whole])
                columns = np.concatenate([np.tile(c, (1, r.shape[1])).ravel() for _, r, c in whole])
                data = np.concatenate([b.ravel() for b, _, _ in whole])
                matrix = coo_matrix((data, (rows, columns)), (self.size, self.size)).tocsc()
                change = splu(matrix[self.free][:, self.free]).solve(-residual)
                moved = change[self.free < 2 * len(self.grid.nodes)]
                change *= min(1.0, LONGEST_M / np.abs(moved).max())
                z[self.free] += change
                if np.abs(moved).max() < 1e-11:
                    break
            else:
                raise ArithmeticError("Newton's method did not converge")
            residual, _, press, gap = self.finger(z, depth_m, held, penalty)
            held = press
            if np.abs(gap).max() < 1e-9:
                break
        return z, held, 2 * float(residual[1 : 2 * len(self.grid.nodes) : 2].sum())


def forces_n_per_mm(poisson: float, m: int) -> list[float]:
    """One per pressure, 2.5 mm deep over the vessel."""
    problem = Problem(make_grid(m), poisson)
    now = np.zeros(problem.size), np.zeros((len(problem.grid.surface), 2)), 0.0
    at, found = np.zeros(2), []
    for mmhg in PRESSURES_MMHG:
        goal = np.array([DEPTH_M, PA_PER_MMHG * mmhg])
        share = FIRST_STEP
        while np.any(at != goal):
            step = at + share * (goal - at) if share < 1 else goal
            try:
                now = problem.solve(now[0].copy(), now[1], *step)
            except ArithmeticError:
                share /= 2
                continue
            at, share = step, min(1.0, 1.7 * share / (1 - min(share, 0.99)))
        found.append(1e-3 * now[2])
    return found


def main() -> None:
    """Go on with the table where it stopped; each ratio takes minutes."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else TABLE
    table: dict[str, Any] = {
        "made_by": "benchmarks/taylor_hood.py", "scene": "TIHA", "plane": "strain",
        "x_mm": 32.0, "depth_mm": 1e3 * DEPTH_M, "presses": [],
    }  # fmt: skip
    if path.exists():
        table = json.loads(path.read_text(encoding="utf-8"))
    done = [row["poisson"] for row in table["presses"]]
    for poisson in POISSON:
        if poisson in done:
            continue
        coarse, fine = (np.array(forces_n_per_mm(poisson, m)) for m in MESHES)
        limit = fine + (fine - coarse) / ((MESHES[1] / MESHES[0]) ** ORDER - 1)
        table["presses"].append({
            "poisson": poisson,
            "pressures_mmhg": PRESSURES_MMHG,
            "force_n_per_mm": limit.round(8).tolist(),
            "meshes": {str(m): each.round(8).tolist()
                       for m, each in zip(MESHES, (coarse, fine), strict=True)},
        })  # fmt: skip
        path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
