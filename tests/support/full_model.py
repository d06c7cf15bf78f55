"""The finite elements themselves as a force model: every place, depth and pressure is pressed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array
from sim_backend.models.press import Press, press
from sim_backend.models.press_range import MOST_MMHG, reach_mm
from sim_backend.models.response import Range
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG


@dataclass(frozen=True)
class FullModel:
    """Presses into ``scene`` with errors of at most ``accuracy_pct`` where that can be reached.

    Places and depths that are asked for together are pressed once each, with all their pressures.
    """

    scene: Scene
    accuracy_pct: float = 1.0

    @property
    def range(self) -> Range:
        left, right = reach_mm(self.scene)
        deepest_m = 1e-3 * self.scene.surface_mm
        return Range((1e-3 * left, 1e-3 * right), (0.0, deepest_m), (0.0, MOST_MMHG * PA_PER_MMHG))

    def force_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        return self._each(x_m, depth_m, pressure_pa, lambda one, k: one.states[k].force_n)

    def error_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        def error(one: Press, k: int) -> float:
            return 0.01 * one.force_error_estimate_pct * one.states[k].force_n

        return self._each(x_m, depth_m, pressure_pa, error)

    def pulse_error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike
    ) -> Array:
        places = np.broadcast_arrays(x_m, depth_m, low_pa, high_pa)
        found = np.zeros(places[0].shape)
        for i in np.ndindex(found.shape):
            x, d, low, high = (float(one[i]) for one in places)
            if d > 0 and low != high:
                one = _pressed(self.scene, x, d, tuple(sorted((low, high))), self.accuracy_pct)
                found[i] = one.pulse_error_n or 0.0
        return found

    def _each(
        self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike,
        value: Callable[[Press, int], float],
    ) -> Array:  # fmt: skip
        """``value`` of each press and the number of its state; 0 in the air."""
        self.range.check(x_m, np.maximum(depth_m, 0.0), pressure_pa)
        x, depth, pressure = (np.asarray(a, float) for a in
                              np.broadcast_arrays(x_m, depth_m, pressure_pa))  # fmt: skip
        found = np.zeros(x.shape)
        for place in {(float(a), float(b)) for a, b in zip(x.flat, depth.flat, strict=True)}:
            here = (x == place[0]) & (depth == place[1])
            levels = tuple(sorted({float(p) for p in pressure[here]}))
            if place[1] > 0:
                one = _pressed(self.scene, *place, levels, self.accuracy_pct)
                found[here] = [value(one, levels.index(float(p))) for p in pressure[here]]
        return found


@lru_cache(maxsize=32)
def _pressed(
    scene: Scene, x_m: float, depth_m: float, levels_pa: tuple[float, ...], accuracy_pct: float
) -> Press:
    mmhg = [p / PA_PER_MMHG for p in levels_pa]
    return press(scene, 1e3 * x_m, 1e3 * depth_m, mmhg, accuracy_pct=accuracy_pct)
