"""The force of soft contact for everybody's simulator: many places, depths and pressures at once.

It imports neither rig nor window nor finite elements: a `TouchTable` is evaluated.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_backend.arrays import Array
from sim_backend.scene.scene_file import Scene, SceneError, load_scene
from sim_backend.touch.bodies import Units
from sim_backend.touch.kept import table_for
from sim_backend.touch.kinds import BARE, Kind
from sim_backend.touch.table import TouchTable, block_of

PLACES, DEPTHS = 321, 33
"""Of the grid on which a scene's forces are interpolated by cubics: the built-in scenes' are then
within 1e-6 of the table's, which is off by 1.2e-3 (median, `benchmarks/touch.py`); within 1 mm of a
block's sides, where the table's own coordinates are clipped, within 2e-3 of the largest force."""
FOUR = np.arange(4)[:, None]
AT_ONCE = 4096
"""States whose intermediate numbers stay in a processor's cache."""


class Touch:
    """What a finger feels on a ``scene`` that a touch table knows.

    Examples
    --------
    >>> import palpate
    >>> felt = palpate.touch("TIT")
    >>> 0.8 < float(felt.force_n(32.0, 2.5)) < 1.0
    True
    """

    def __init__(self, scene: Scene) -> None:
        if scene.tissue is None or (table := table_for(scene)) is None:
            raise SceneError(
                f"{scene.name}: no touch table knows this finger on this support; `palpate touch` "
                "lists those there are, and makes others"
            )
        if not table.knows(scene):
            raise SceneError(f"{scene.name}: its touch table knows no block of this size")
        bodies = [Units(scene).parameters(body) for body in scene.inclusion]
        for n, (kind, theta) in enumerate(bodies):
            if not kind.fits(theta[None])[0]:
                raise SceneError(f"{scene.name}: inclusion {n + 1} lies beyond its touch table")
        self.scene = scene
        self._half_mm = scene.indenter.width_mm_projected / 2
        self._half_width = scene.tissue.width_mm / 2 / self._half_mm
        self._unit_n = 1e-3 * scene.tissue.modulus_kpa * self._half_mm * scene.indenter.length_mm
        self._depths = table.depths
        self._on_grid = self._drawn(table, bodies, block_of(scene))

    def force_n(self, x_mm: Any, depth_mm: Any, pressure_mmhg: Any = None) -> Array:
        """Force [N] at places ``x_mm`` pressed ``depth_mm`` deep, with ``pressure_mmhg`` in all
        lumens (by default the diastolic one), which are broadcast against each other.

        Raises ValueError where any of them is beyond what the table knows.
        """
        (still, beat), pressure = self._at(x_mm, depth_mm, pressure_mmhg, slice(0, 2))
        return np.asarray(still + pressure * beat)

    def error_n(self, x_mm: Any, depth_mm: Any, pressure_mmhg: Any = None) -> Array:
        """What `force_n` is off by [N], one standard deviation, as held-out presses were."""
        (still, beat), pressure = self._at(x_mm, depth_mm, pressure_mmhg, slice(2, 4))
        return np.asarray(np.hypot(still, pressure * beat))

    def _drawn(
        self, table: TouchTable, bodies: Sequence[tuple[Kind, Array]], block: Array
    ) -> Array:
        """Over the depth [N], on a grid of places and depths (`PLACES`, `DEPTHS`, 4): the force at
        diastole, what the pulse adds to it, and the errors of both."""
        places = np.linspace(-self._half_width, self._half_width, PLACES)
        x, sunk = (one.ravel() for one in np.meshgrid(
            places, np.geomspace(*self._depths, DEPTHS), indexing="ij",
        ))  # fmt: skip
        whole, beat = np.ones(len(x)), np.zeros(len(x))
        still_off = np.hypot(*table.ratios[BARE.name].error[:, 0])
        off = np.tile([still_off, 0.0], (len(x), 1)) ** 2
        for kind, theta in bodies:
            ratios, here = table.ratios[kind.name], np.tile(theta, (len(x), 1))
            bump, pulse = ratios(x, sunk, here).T
            whole, beat, off = whole + bump, beat + pulse, off + ratios.off_by(x, here) ** 2
        force = self._unit_n * table.bare_force(x, sunk, block) / sunk
        values = force[:, None] * np.column_stack([whole, beat, np.sqrt(off)])
        return np.asarray(values.reshape(PLACES, DEPTHS, 4))

    def _at(
        self, x_mm: Any, depth_mm: Any, pressure_mmhg: Any, which: slice
    ) -> tuple[Array, Array]:
        """Some of what was `_drawn`, times the depth, (k, ...) at places and depths; and the
        pressure, from 0 at diastole to 1 at systole."""
        low, high = self.scene.pulse.diastolic_mmhg, self.scene.pulse.systolic_mmhg
        given = low if pressure_mmhg is None else pressure_mmhg
        x, sunk, pressure = np.broadcast_arrays(x_mm, depth_mm, given)
        shape = x.shape
        x = x.ravel() / self._half_mm - self._half_width
        sunk, beat = sunk.ravel() / self._half_mm, (pressure - low) / (high - low)
        self._check(x, sunk, beat)
        (shallow, deep), grid = self._depths, self._on_grid[:, :, which]
        along = (x / self._half_width + 1) / 2 * (PLACES - 1)
        # between none and the shallowest that was trained on the force is in proportion
        down = np.log(np.maximum(sunk / shallow, 1)) / np.log(deep / shallow) * (DEPTHS - 1)
        at, blocks = np.array([along, down]), range(0, len(x), AT_ONCE)
        found = [_cubic(grid, at[:, k : k + AT_ONCE]) for k in blocks]
        return (sunk * np.concatenate(found, axis=1)).reshape(-1, *shape), beat

    def _check(self, x: Array, sunk: Array, beat: Array) -> None:
        ends_mm = self._half_mm * self._half_width * np.array([0.0, 2.0])
        pulse, deepest = self.scene.pulse, self._depths[1]
        for name, values, low, high, words in (
            ("x_mm", x, -self._half_width, self._half_width, "{:g} to {:g} mm".format(*ends_mm)),
            ("depth_mm", sunk, 0, deepest, f"0 to {deepest * self._half_mm:g} mm"),
            ("pressure_mmhg", beat, 0, 1,
             f"{pulse.diastolic_mmhg:g} to {pulse.systolic_mmhg:g} mmHg"),
        ):  # fmt: skip
            if not ((values >= low - 1e-9) & (values <= high + 1e-9)).all():
                raise ValueError(f"{name}: the touch table knows {words}")


def touch(scene: Scene | str) -> Touch:
    """The force on a finger over a scene, in microseconds a state.

    Parameters
    ----------
    scene
        A scene, or a built-in one's name or a scene file's path.

    Returns
    -------
    Touch
        Callable for any places, depths and pressures of the scene.

    Raises
    ------
    SceneError
        No touch table knows the scene.

    Examples
    --------
    >>> import palpate
    >>> felt = palpate.touch("TIHA")
    >>> felt.force_n([24.0, 32.0], 2.5, [[80.0], [120.0]]).shape
    (2, 2)
    """
    return Touch(load_scene(scene) if isinstance(scene, str) else scene)


def _cubic(grid: Array, at: Array) -> Array:
    """Values (k, n) of a ``grid`` (a, b, k) at ``at`` (2, n), which counts its points: Lagrange's
    cubic through the four nearest in both directions."""
    last = np.array([[grid.shape[0]], [grid.shape[1]]]) - 4
    begin = np.minimum(np.maximum(at.astype(int) - 1, 0), last)
    a = at - begin
    b, c, d = a - 1, a - 2, a - 3
    ab, cd = a * b, c * d
    along, down = np.array([b * cd / -6, a * cd / 2, ab * d / -2, ab * c / 6]).swapaxes(0, 1)
    i, j = begin[:, None] + FOUR
    return np.asarray(np.einsum("ijnk,in,jn->kn", grid[i[:, None], j], along, down))
