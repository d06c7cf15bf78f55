"""Vessels that run obliquely or on a path: a section's nodes, slid across plane by plane.

The section is meshed as it is at z = 0 and extruded. From there to either end each plane of nodes
is the one before, moved so that every vessel's circle comes to where its path has gone. What lies
between follows by Laplace's equation, stiffer where triangles are small (Masud and Hughes 1997), so
that large ones give way; small moves one after another fold nothing. Where a vessel leans by
s = dc/dz, a plane z cuts it in an ellipse, longer by sqrt(1 + s^2) that way: the tube is round.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from sim_backend.arrays import Array, Ints
from sim_backend.fem.mesh import Mesh
from sim_backend.scene.inclusion import Artery, Inclusion
from sim_backend.scene.scene_file import Scene

QUARTERS = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))
"""A six-node triangle as four."""
STEP_M = 0.5e-3
"""Longest way that a plane is moved at once."""


class _Circle(NamedTuple):
    one: Inclusion
    nodes: Ints
    off_m: Array


def across(scene: Scene, mesh: Mesh, planes: Array) -> Array:
    """Places (p, n, 2) [m] of the section's nodes in each of ``planes`` (p,) [m], of which one is
    at z = 0."""
    height_m = 1e-3 * scene.surface_mm
    circles = []
    for one in scene.inclusion:
        off = mesh.nodes - _centre(one, 0.0, height_m)
        inside = np.flatnonzero(np.hypot(*off.T) < 1e-3 * one.outer_radius_mm + 1e-9)
        circles.append(_Circle(one, inside, off[inside]))
    placed = np.repeat(mesh.nodes[None], len(planes), axis=0)
    middle = int(np.argmin(np.abs(planes)))
    for way in (1, -1):
        now = mesh.nodes
        for k in range(middle, len(planes) if way > 0 else -1, way):
            now = _moved(mesh, now, circles, 1e3 * planes[k], height_m)
            placed[k] = now
    return placed


def lean(one: Artery, z_mm: float) -> Array:
    """How far the path goes to larger x and y per length along z; at its corners the mean."""
    if not one.path or not one.path[0][0] <= z_mm <= one.path[-1][0]:
        return np.zeros(2)
    step_mm = 1e-3
    inner_mm = float(np.clip(z_mm, one.path[0][0] + step_mm, one.path[-1][0] - step_mm))
    low, high = (one.centre_mm(inner_mm + step) for step in (-step_mm, step_mm))
    return np.subtract(high, low) * [1, -1] / (2 * step_mm)  # depth is down


def end_thrust(one: Artery, z_mm: float) -> Array:
    """Force (3,) per pressure [m2] on the end of a vessel that leaves the block at ``z_mm``, to
    larger z, where it is free of tension along itself.

    The pressure between a cut across the vessel and the block's end is not in balance by itself:
    on the end it pushes by A (sqrt(1 + s^2) e_z - t), A the lumen's area and t its direction, as
    if the end's plane were closed and the cut across open. Without it an oblique vessel would turn
    the block.
    """
    slope = lean(one, z_mm)
    longer = float(np.sqrt(1 + slope @ slope))
    ring = one.stenosis
    narrowed = ring is not None and (ring.z_mm is None or ring.z_mm[0] <= z_mm <= ring.z_mm[1])
    left = 1 - ring.fraction if ring is not None and narrowed else 1.0
    area = np.pi / 4 * (1e-3 * one.inner_diameter_mm * left) ** 2
    along = np.array([*slope, 1.0]) / longer
    return np.asarray(area * (np.array([0.0, 0.0, longer]) - along))


def _centre(one: Inclusion, z_mm: float, height_m: float) -> Array:
    x_mm, depth_mm = one.centre_mm(z_mm)
    return np.array([1e-3 * x_mm, height_m - 1e-3 * depth_mm])


def _moved(mesh: Mesh, now: Array, circles: list[_Circle], z_mm: float, height_m: float) -> Array:
    """The nodes ``now`` (n, 2) with each circle's where they are at ``z_mm``."""
    known = np.concatenate([circle.nodes for circle in circles])
    goal = np.concatenate([_at(circle, z_mm, height_m) for circle in circles])
    steps = max(1, int(np.ceil(np.abs(goal - now[known]).max() / STEP_M)))
    for left in range(steps, 0, -1):
        way = (goal - now[known]) / left
        if np.abs(way).max() < 1e-12:
            break
        now = now + _followed(mesh, now, known, way, height_m)
    return now


def _at(circle: _Circle, z_mm: float, height_m: float) -> Array:
    centre = _centre(circle.one, z_mm, height_m)
    if not isinstance(circle.one, Artery):
        return centre + circle.off_m
    slope = lean(circle.one, z_mm)
    steep = float(slope @ slope)
    longer = (np.sqrt(1 + steep) - 1) / steep if steep else 0.0
    return np.asarray(centre + circle.off_m + longer * (circle.off_m @ slope)[:, None] * slope)


def _followed(mesh: Mesh, now: Array, known: Ints, way: Array, height_m: float) -> Array:
    """The move (n, 2) of all nodes where those ``known`` (k,) move by ``way`` (k, 2). Along the
    surface, the bottom and the sides nodes slide."""
    stiffness = _laplacian(mesh, now)
    width_m = mesh.nodes[:, 0].max()
    found = np.zeros_like(now)
    for axis, end in ((0, width_m), (1, height_m)):
        fixed = np.abs(mesh.nodes[:, axis] - end / 2) > end / 2 - 1e-9
        fixed |= mesh.nodes[:, 1] > height_m - 1e-9
        found[known, axis] = way[:, axis]
        fixed[known] = True
        free = np.flatnonzero(~fixed)
        right = -(stiffness @ found[:, axis])[free]
        found[free, axis] = splu(csc_matrix(stiffness[free][:, free])).solve(right)
    return found


def _laplacian(mesh: Mesh, now: Array) -> csc_matrix:
    """Of linear triangles, each as much stiffer as it is smaller."""
    corners = np.concatenate([mesh.cells[:, quarter] for quarter in QUARTERS])
    sides = np.roll(now[corners], 1, axis=1) - np.roll(now[corners], -1, axis=1)
    area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    blocks = np.einsum("tai,tbi->tab", sides, sides) / (4 * area**2)[:, None, None]
    rows, columns = (np.broadcast_to(c, blocks.shape) for c in
                     (corners[:, :, None], corners[:, None, :]))  # fmt: skip
    n = len(now)
    return csc_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))
