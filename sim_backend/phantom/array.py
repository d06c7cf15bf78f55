"""A simulated array of taxels: the elements' own force on each, as a device with faults reads it.

reading = dead (gain (crosstalk (skin (force on each taxel)))) over a taxel's area, all of them
linear: one matrix from forces to readings.
"""

from typing import Annotated, Self
from zlib import crc32

import numpy as np
from pydantic import Field, model_validator

from drivers.core.array_layout import taxel_names
from drivers.core.protocols import Channel
from drivers.core.settings import NonNegative, Positive
from drivers.core.table import Table
from sim_backend.arrays import Array, Bools
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray


class VirtualArray(Table):
    """An array in the finger: rows along the vessels, columns across, taxel [0, 0] at the least x
    and y; without a pitch they share the finger's face. The defaults are ideal but for noise and
    steps, those of the emulated serial array.
    """

    rows: Annotated[int, Field(ge=1)]
    columns: Annotated[int, Field(ge=1)]
    pitch_mm: Positive | None = None
    skin_spread_mm: NonNegative = 0.0
    crosstalk_pct: NonNegative = 0.0
    gain_spread_pct: NonNegative = 0.0
    dead: tuple[tuple[int, int], ...] = ()
    noise_pa: NonNegative = 20.0
    quantum_pa: NonNegative = 10.0
    full_scale_kpa: Positive | None = None

    @property
    def layout(self) -> TaxelArray:
        """Where the taxels are."""
        return TaxelArray(self.rows, self.columns, self.pitch_mm)

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        _ = self.layout  # raises what it says of too many
        for row, column in self.dead:
            if not (0 <= row < self.rows and 0 <= column < self.columns):
                raise ValueError(
                    f"dead = [{row}, {column}]: rows are 0 to {self.rows - 1}, columns 0 to "
                    f"{self.columns - 1}"
                )
        return self


class Taxels:
    """What an array on the phantom's finger reads [Pa], row by row. Raises `SceneError` where the
    finger carries another one."""

    def __init__(self, phantom: Phantom, keys: VirtualArray, name: str, seed: int) -> None:
        phantom.feel_with(keys.layout)
        full_pa = 1e3 * keys.full_scale_kpa if keys.full_scale_kpa else None
        self.channels = tuple(
            Channel(name, "Pa", "taxel", simulated=True, full_scale=full_pa)
            for name in taxel_names(keys.rows, keys.columns)
        )
        alive = np.ones((keys.rows, keys.columns))
        for place in keys.dead:
            alive[place] = 0.0
        self.noise = keys.noise_pa * alive.ravel()
        rng = np.random.default_rng([seed, crc32(f"{name} gains".encode())])
        gain = alive.ravel() * (1 + 1e-2 * keys.gain_spread_pct * rng.standard_normal(alive.size))
        matrix = crosstalk(keys.rows, keys.columns, 1e-2 * keys.crosstalk_pct)
        matrix = matrix @ skin_spread(phantom.scene, keys.layout, 1e-3 * keys.skin_spread_mm)
        self._pa_per_n = gain[:, None] * matrix / taxel_m2(phantom.scene, keys.layout)
        self._step_pa, self._full_pa = keys.quantum_pa, full_pa
        self._phantom = phantom

    def read(self, time_s: Array, _since_start_s: Array, noise: Array) -> tuple[Array, Bools]:
        """Readings (n, taxels) of the forces at ``time_s`` (n,), and which of them are clipped;
        ``noise`` (n, taxels) [Pa] is added."""
        forces = self._phantom.taxels_n(time_s).reshape(len(time_s), -1)
        read = forces @ self._pa_per_n.T + noise
        clipped = np.zeros(read.shape, dtype=bool)
        if self._full_pa is not None:
            clipped = np.abs(read) >= self._full_pa
            read = np.clip(read, -self._full_pa, self._full_pa)
        if self._step_pa:
            read = np.round(read / self._step_pa) * self._step_pa
        return read, clipped


def taxel_m2(scene: Scene, array: TaxelArray) -> float:
    """The area of a taxel: of a pitch, or its part of the finger's face."""
    if array.pitch_mm is not None:
        return 1e-6 * array.pitch_mm**2
    return 1e-6 * scene.face_mm2 / (array.rows * array.columns)


def crosstalk(rows: int, columns: int, share: float) -> Array:
    """Matrix (n, n) by which each taxel also shows a ``share`` of each of its four neighbours."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    apart = np.abs(row[:, None] - row) + np.abs(column[:, None] - column)
    return np.asarray(np.eye(rows * columns) + share * (apart == 1))


def skin_spread(scene: Scene, array: TaxelArray, deep_m: float) -> Array:
    """Shares (n, n) of the force on each taxel (column) that reach each one (row) where it is
    sensed ``deep_m`` under a skin: the vertical stress in a half-space under a uniform pressure on
    a rectangle (Holl 1940, Stress transmission in earths), at the middle of each taxel.

    What reaches beyond the array is not felt.
    """
    count = array.rows * array.columns
    if deep_m == 0.0:
        return np.eye(count)
    across, along = array.edges_m(scene.indenter)
    x, y = np.meshgrid((across[1:] + across[:-1]) / 2, (along[1:] + along[:-1]) / 2)
    x_end, y_end = (np.subtract.outer(middle.ravel(), middle.ravel()) for middle in (x, y))
    half_x, half_y = np.diff(across)[0] / 2, np.diff(along)[0] / 2
    return np.asarray(sum(
        s * t * under_corner(x_end + s * half_x, y_end + t * half_y, deep_m)
        for s in (1, -1) for t in (1, -1)
    ))  # fmt: skip


def under_corner(a: Array, b: Array, deep: float) -> Array:
    """Vertical stress ``deep`` under the corner of a rectangle of sides a and b, over the pressure
    on it; odd in both."""
    near_a, near_b = a**2 + deep**2, b**2 + deep**2
    far = np.sqrt(a**2 + near_b)
    sides = a * b * deep / far * (1 / near_a + 1 / near_b)
    return np.asarray((np.arctan(a * b / (deep * far)) + sides) / (2 * np.pi))
