"""Shared by all tests: an answer of tissue that needs no finite elements."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backend.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Winkler:
    """A bed of springs with a vessel that passes part of its pressure on.

    F = k d + A p d / 2.5 mm, with k stiffer over an inclusion at 32 mm.
    """

    stiffness_n_m: float
    area_m2: float

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        depth = np.maximum(depth_m, 0.0)
        return self.stiffness_n_m * depth + self.area_m2 * pressure_pa * depth / 2.5e-3

    def von_mises_pa(self, depth_m: Array, pressure_pa: Array) -> Array:
        return self.force_n(depth_m, pressure_pa) / 1e-4


def respond_winkler(scene: Scene, x_m: float, _max_depth_m: float) -> Winkler:
    near = np.exp(-(((x_m - 0.032) / 0.006) ** 2)) if scene.inclusion else 0.0
    return Winkler(400.0 * (1 + 0.2 * near), 2e-6 * near if scene.arteries else 0.0)


@pytest.fixture
def winkler() -> Callable[[Scene, float, float], Winkler]:
    """A quick stand-in for `sim_backend.response.respond`."""
    return respond_winkler
