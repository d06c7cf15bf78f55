"""The finite elements themselves as a station: every depth and pressure of a place is pressed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array
from sim_backend.models.press import Press, press
from sim_backend.models.press_range import MOST_MMHG
from sim_backend.models.response import Range
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG


@dataclass(frozen=True)
class FullModel:
    """Presses into ``scene`` at ``x_m`` with errors of at most ``accuracy_pct`` where that can be
    reached. Pressures that are asked for together at a depth are pressed together."""

    scene: Scene
    x_m: float
    accuracy_pct: float = 1.0

    @property
    def range(self) -> Range:
        return Range((0.0, 1e-3 * self.scene.surface_mm), (0.0, MOST_MMHG * PA_PER_MMHG))

    def force_n(self, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        return self._each(depth_m, pressure_pa, lambda one, k: one.states[k].force_n)

    def error_n(self, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        def error(one: Press, k: int) -> float:
            return 0.01 * one.force_error_estimate_pct * one.states[k].force_n

        return self._each(depth_m, pressure_pa, error)

    def pulse_error_n(self, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike) -> Array:
        states = np.broadcast_arrays(depth_m, low_pa, high_pa)
        found = np.zeros(states[0].shape)
        for i in np.ndindex(found.shape):
            d, low, high = (float(one[i]) for one in states)
            if d > 0 and low != high:
                found[i] = self._pressed(d, (low, high)).pulse_error_n or 0.0
        return found

    def _each(
        self, depth_m: ArrayLike, pressure_pa: ArrayLike, value: Callable[[Press, int], float]
    ) -> Array:
        """``value`` of each press and the number of its state; 0 in the air."""
        self.range.check(np.maximum(depth_m, 0.0), pressure_pa)
        depth, pressure = (np.asarray(a, float) for a in
                           np.broadcast_arrays(depth_m, pressure_pa))  # fmt: skip
        found = np.zeros(depth.shape)
        for d in {float(a) for a in depth.flat if a > 0}:
            here = depth == d
            levels = tuple(sorted({float(p) for p in pressure[here]}))
            one = self._pressed(d, levels)
            found[here] = [value(one, levels.index(float(p))) for p in pressure[here]]
        return found

    def _pressed(self, depth_m: float, levels_pa: tuple[float, ...]) -> Press:
        return _pressed(self.scene, self.x_m, depth_m, tuple(sorted(levels_pa)), self.accuracy_pct)


@lru_cache(maxsize=32)
def _pressed(
    scene: Scene, x_m: float, depth_m: float, levels_pa: tuple[float, ...], accuracy_pct: float
) -> Press:
    mmhg = [p / PA_PER_MMHG for p in levels_pa]
    return press(scene, 1e3 * x_m, 1e3 * depth_m, mmhg, accuracy_pct=accuracy_pct)
