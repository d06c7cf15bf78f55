"""Axis errors of a stage: scale, squareness and how it is turned against the scan frame.

true = matrix @ read + shift,   matrix = rotation @ (upper triangular: scales and shears)
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, as_columns, linear_fit, same_length, stacked

LARGEST_SCALE = 1.5
"""Times that an axis may go further than it reads, or less far: a wrong lead or gear is twofold."""
ADVICE = "add points away from the line or plane through the others, across the whole travel"


@dataclass(frozen=True)
class AxesCalibration:
    """``matrix`` (3, 3) and ``shift_m`` (3,) from what the stage reads to the scan frame."""

    KIND: ClassVar[str] = "axes"
    UNITS: ClassVar[dict[str, str]] = {"matrix": "1", "shift_m": "m"}
    matrix: Array
    shift_m: Array
    fit: Fit = field(repr=False)

    def true(self, read_m: Array) -> Array:
        """Scan-frame points (..., 3) [m] from the stage's readings."""
        return np.asarray(np.asarray(read_m) @ self.matrix.T + self.shift_m)

    def command(self, target_m: Array) -> Array:
        """What the stage must read (..., 3) [m] to be at ``target_m`` in the scan frame."""
        return np.asarray(np.linalg.solve(self.matrix, (np.asarray(target_m) - self.shift_m).T).T)

    def misses(self, read_m: Array, true_m: Array) -> Array:
        """True places less the expected ones (3 n,) [m]."""
        return np.asarray((np.asarray(true_m) - self.true(read_m)).ravel())


def fit_axes(read_m: Array, true_m: Array) -> AxesCalibration:
    """Axis errors from points (n, 3) the stage read and where they were (a gauge, a tracker).

    Raises `CalibrationError` for coplanar or too few points, a mirrored frame, or axes in another
    unit.
    """
    read, true = as_columns(read_m, "read_m", 3), as_columns(true_m, "true_m", 3)
    same_length(read_m=read, true_m=true)
    mean = read.mean(axis=0)
    spread = np.linalg.svd(read - mean, compute_uv=False)
    if len(read) < 5 or spread[-1] < 0.01 * spread[0]:
        raise CalibrationError(f"{len(read)} points, nearly in one plane or line; {ADVICE}")
    design = np.column_stack([read - mean, np.ones(len(read))])
    names = ("x", "y", "z", "shift")
    fits = [linear_fit(design, axis, names, ADVICE, weakest=1e-4) for axis in true.T]
    matrix = np.array([fit.values[:3] for fit in fits])
    if np.linalg.det(matrix) <= 0:
        raise CalibrationError(
            "the stage's frame is mirrored against the scan frame; swap two axes or turn one round"
        )
    lengths = np.linalg.svd(matrix, compute_uv=False)
    if lengths[-1] < 1 / LARGEST_SCALE or lengths[0] > LARGEST_SCALE:
        raise CalibrationError(
            f"the stage goes {lengths[-1]:.3g} to {lengths[0]:.3g} times as far as it reads; "
            f"{1 / LARGEST_SCALE:.2g} to {LARGEST_SCALE:g} are an error of its axes. Are both in "
            "one unit? Set its steps per millimetre first"
        )
    shift = np.array([fit.values[3] for fit in fits]) - matrix @ mean
    return AxesCalibration(matrix, shift, stacked(fits))
