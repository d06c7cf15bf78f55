"""One place of a phantom, solved beforehand, so that feeling it costs only interpolation.

The finite elements answer at a few depths and two lumen pressures; displacement and stress are
kept on a regular grid of the deformed section: at each point, where its material came from and
its stress. Between the solved states they are linear in depth and in pressure. The force is
the place's force model's, which is smooth in both.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.tri import LinearTriInterpolator, Triangulation
from scipy.ndimage import distance_transform_edt, map_coordinates

from drivers.core.arrays import Array, Bools
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

if TYPE_CHECKING:
    from sim_backend.fem.newton import Solution
    from sim_backend.fem.picture import Picture
    from sim_backend.phantom.phantom import Response

DEPTHS = 6
CELL_MM = 0.25
PULLS = 8  # fixed-point steps of the pull-back; the error shrinks by |grad u| < 1 each


class PressState(NamedTuple):
    """What a press answers: total force, contact (left, right) and the pictures' fields."""

    force_n: float
    contact_mm: tuple[float, float]
    came_mm: Array  # (rows, columns, 2), as in `Table`
    von_mises_pa: Array  # (rows, columns)


@dataclass(frozen=True)
class Table:
    """Answers over ``depth_m`` (d,) and ``pressure_pa`` (2,) on a grid of the section.

    ``x_mm`` (columns,), ``y_mm`` (rows,) upwards from the support; ``inside`` (rows, columns) is
    material at rest. ``came_mm`` (d, 2, rows, columns, 2) is how far what is at a point has come,
    ``von_mises_pa`` (d, 2, rows, columns) belongs to the place at rest, ``contact_mm`` (d, 2, 2).
    ``forces`` knows the force.
    """

    x_mm: Array
    y_mm: Array
    inside: Bools
    depth_m: Array
    pressure_pa: Array
    came_mm: Array
    von_mises_pa: Array
    contact_mm: Array
    forces: "Response"

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        """Total force (n,) at depths and lumen pressures (n,), both clamped to the solved range."""
        depth_m = np.clip(depth_m, 0.0, self.depth_m[-1])
        return self.forces.force_n(depth_m, np.clip(pressure_pa, *self.pressure_pa))

    def press(self, depth_m: float, pressure_pa: float) -> PressState:
        """The answer at a depth (clamped to the solved range) and a lumen pressure."""
        depth_m = float(np.clip(depth_m, 0.0, self.depth_m[-1]))
        low, high = self.pressure_pa
        at_pa = float(np.clip(pressure_pa, low, high))
        w = (at_pa - low) / (high - low) if high > low else 0.0
        k = int(np.clip(np.searchsorted(self.depth_m, depth_m) - 1, 0, len(self.depth_m) - 2))
        v = (depth_m - self.depth_m[k]) / (self.depth_m[k + 1] - self.depth_m[k])

        def between(table: Array) -> Array:
            a, b = table[k], table[k + 1]
            mix = (1 - v) * ((1 - w) * a[0] + w * a[1]) + v * ((1 - w) * b[0] + w * b[1])
            return np.asarray(mix)

        left, right = between(self.contact_mm)
        return PressState(
            float(self.force_n(np.array(depth_m), np.array(at_pa))),
            (float(left), float(right)),
            between(self.came_mm),
            between(self.von_mises_pa),
        )

    def picture(self, state: PressState) -> Array:
        """Von Mises stress (rows, columns) [Pa] where the material is now; NaN outside."""
        at = _origin(state.came_mm, (self.x_mm, self.y_mm))
        stress = map_coordinates(state.von_mises_pa, at, order=1, mode="nearest")
        solid = map_coordinates(self._solid, at, order=1, mode="constant")
        return np.where(solid > 0.5, stress, np.nan)

    @cached_property
    def _solid(self) -> Array:
        return self.inside.astype(float)

    @cached_property
    def highest_pa(self) -> float:
        """Top of a colour scale for the tissue in the deepest press; walls may be beyond it."""
        return float(np.percentile(self.von_mises_pa[-1], 98))


def came_mm(displacement_mm: Array, grid: tuple[Array, Array]) -> Array:
    """How far what is at each point of the grid has come (rows, columns, 2) [mm], from how far
    what was there has gone: came(x) = gone(x - came(x)), by fixed-point steps."""
    came = displacement_mm
    for _ in range(PULLS):
        at = _origin(came, grid)
        came = np.stack(
            [map_coordinates(displacement_mm[..., n], at, order=1, mode="nearest") for n in (0, 1)],
            axis=-1,
        )
    return came


def _origin(came: Array, grid: tuple[Array, Array]) -> Array:
    """Rows and columns (2, rows, columns) from where the material came."""
    x, y = grid
    rows, columns = np.indices(came.shape[:2], dtype=float)
    return np.stack([rows - came[..., 1] / (y[1] - y[0]), columns - came[..., 0] / (x[1] - x[0])])


def solve(scene: Scene, x_mm: float, max_depth_mm: float) -> Table:
    """Solve one place; a solid's pictures are of its cut at z = 0. Raises `CannotSolve`; takes
    seconds, so not in a frame."""
    # here: the window opens before the solver is loaded
    from sim_backend.models.station_response import respond
    from sim_backend.models.stations import ramp

    pulse = scene.pulse
    mmhg = (pulse.diastolic_mmhg, pulse.systolic_mmhg)
    depths_mm = np.linspace(0.0, max_depth_mm, DEPTHS)
    pressure_pa = np.array(mmhg) * PA_PER_MMHG
    solved = ramp(scene, 1e-3 * x_mm, (1e-3 * depths_mm[1:]).tolist(), pressure_pa.tolist())
    grid, picture = _grid(scene), solved[0].picture
    fields = [[_fields(picture, state, grid) for state in pressed.states] for pressed in solved]
    inside = fields[0][0][2]
    zero = np.zeros_like(fields[0][0][1])
    rest = [(np.zeros((*zero.shape, 2)), zero, inside)] * 2  # the paper's start: unloaded
    states = [rest, *fields]
    contact = [np.full((2, 2), x_mm), *(1e3 * pressed.contact_m[:, :2] for pressed in solved)]
    return Table(
        *grid,
        inside,
        depths_mm * 1e-3,
        pressure_pa,
        np.array([[f[0] for f in pair] for pair in states]),
        np.array([[f[1] for f in pair] for pair in states]),
        np.array(contact),
        respond(scene, 1e-3 * x_mm, 1e-3 * max_depth_mm),
    )


def _grid(scene: Scene) -> tuple[Array, Array]:
    """Columns' x and rows' y [mm], with room around for what bulges."""
    if scene.tissue is not None:
        left, right = 0.0, scene.tissue.width_mm
    else:
        middle, r = scene.inclusion[0].x_mm, scene.inclusion[0].outer_radius_mm
        left, right = middle - r, middle + r
    x = np.arange(left - 3, right + 3, CELL_MM)
    return x, np.arange(-1, scene.surface_mm + 2, CELL_MM)


def _fields(
    picture: "Picture", state: "Solution", grid: tuple[Array, Array]
) -> tuple[Array, Array, Bools]:
    """How far the material came [mm], its von Mises stress [Pa] and its mask at rest, on the grid.

    Beyond the material both are those of the nearest material point, so that edges move with it.
    """
    x, y = 1e3 * picture.nodes_m.T
    mesh = Triangulation(x, y, picture.triangles)
    xx, yy = np.meshgrid(*grid)
    columns = (*(1e3 * picture.displacement_m(state).T), picture.von_mises_pa(state))
    ux, uy, vm = (LinearTriInterpolator(mesh, each)(xx, yy) for each in columns)
    inside = ~np.ma.getmaskarray(vm)
    nearest = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    filled = [np.asarray(each.data)[tuple(nearest)] for each in (ux, uy, vm)]
    return came_mm(np.stack(filled[:2], axis=-1), grid), filled[2], inside
