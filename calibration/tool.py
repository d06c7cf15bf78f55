"""Tool centre point by pivoting: the tip stays in a dimple while the flange turns about it.

For every pose, position + R tip = dimple: linear in tip and dimple.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, as_columns, linear_fit

ADVICE = "add poses tilted by 20 degrees or more about two different axes, tip in the dimple"


@dataclass(frozen=True)
class ToolCalibration:
    """``tip_m`` (3,) in the flange's frame and ``pivot_m`` (3,) in the base's."""

    KIND: ClassVar[str] = "tool"
    UNITS: ClassVar[dict[str, str]] = {"tip_m": "m", "pivot_m": "m"}
    tip_m: Array
    pivot_m: Array
    fit: Fit = field(repr=False)

    def tip(self, position_m: Array, rotations: Array) -> Array:
        """Tip (n, 3) [m] in the base frame from flange positions (n, 3) and R (n, 3, 3)."""
        return np.asarray(position_m + np.asarray(rotations) @ self.tip_m)

    def misses(self, position_m: Array, rotations: Array) -> Array:
        """How far (3 n,) [m] the tip leaves the mean of its places, in whichever dimple."""
        tips = self.tip(position_m, rotations)
        return np.asarray((tips - tips.mean(axis=0)).ravel())


def fit_tool(position_m: Array, rotations: Array) -> ToolCalibration:
    """The tip from flange poses (n, 3) [m] and (n, 3, 3) base from flange.

    Raises `CalibrationError` when the turns leave a direction of the tip open.
    """
    position = as_columns(position_m, "position_m", 3)
    turns = np.asarray(rotations, dtype=float)
    if turns.shape != (len(position), 3, 3) or not np.isfinite(turns).all():
        raise CalibrationError(f"rotations {turns.shape}: expected {(len(position), 3, 3)}, finite")
    still = np.broadcast_to(-np.eye(3), turns.shape)
    design = np.concatenate([turns, still], axis=2).reshape(-1, 6)
    names = tuple(f"{what} {axis}" for what in ("tip", "pivot") for axis in "xyz")
    fit = linear_fit(design, -position.ravel(), names, ADVICE, weakest=0.03)
    return ToolCalibration(fit.values[:3], fit.values[3:], fit)
