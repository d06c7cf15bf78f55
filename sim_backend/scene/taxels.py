"""An array of taxels in a finger, seen from below: rows along the vessels, columns across."""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array
from sim_backend.scene.indenter import Indenter
from sim_backend.scene.scene_file import SceneError

MOST = 4096
"""Taxels of an array: 64 x 64."""


@dataclass(frozen=True)
class TaxelArray:
    """``rows`` x ``columns`` taxels of ``pitch_mm`` either way, their middle under the finger's;
    without a pitch they share its projected width and breadth. Raises `SceneError`.

    Examples
    --------
    >>> import palpate
    >>> array = palpate.TaxelArray(rows=1, columns=4, pitch_mm=1.5)
    >>> pressed = palpate.press("TI", x_mm=32.0, depth_mm=1.0, accuracy_pct=5, taxels=array)
    >>> pressed.states[0].taxels_n.shape
    (1, 4)
    """

    rows: int
    columns: int
    pitch_mm: float | None = None

    def __post_init__(self) -> None:
        if min(self.rows, self.columns) < 1 or self.rows * self.columns > MOST:
            raise SceneError(
                f"taxels = {self.rows} x {self.columns}: from 1 x 1 to {MOST} in all are possible"
            )
        if self.pitch_mm is not None and not 0 < self.pitch_mm < np.inf:
            raise SceneError(f"pitch = {self.pitch_mm:g} mm: must be above 0")

    def edges_m(self, finger: Indenter) -> tuple[Array, Array]:
        """Where columns (columns + 1,) and rows (rows + 1,) begin and end [m], from the middle."""
        sizes = (finger.width_mm_projected, finger.breadth_mm_projected)
        return tuple(  # type: ignore[return-value]
            1e-3 * (self.pitch_mm or size / count) * (np.arange(count + 1) - count / 2)
            for count, size in zip((self.columns, self.rows), sizes, strict=True)
        )
