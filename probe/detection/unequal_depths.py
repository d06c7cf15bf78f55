"""Presses of unequal depth, as to one force: levels compare only as if all were equally deep."""

from collections.abc import Sequence

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.presses import STIFFENING, Press

UNEQUAL = 0.05
"""Of the usual depth: stages repeat theirs to less. A level that differs so much less or more by
its depth alone (6 %) is as different as over a lump."""
STIFFENING_SD = 0.15
"""Of `STIFFENING`: between a flat face's exponent and a sphere's."""


def usual_depth_m(presses: Sequence[Press]) -> float | None:
    """The depth [m] that levels are compared at; None where all are as deep, or none is known."""
    depth_m = _depths_m(presses)
    if not len(depth_m) or not (np.isfinite(depth_m) & (depth_m > 0)).all():
        return None
    usual_m = float(np.median(depth_m))
    return usual_m if np.ptp(depth_m) > UNEQUAL * usual_m else None


def levels_at_one_depth(presses: Sequence[Press]) -> tuple[Array, Array]:
    """Levels [Pa] of presses and their standard deviations (n,), as if all were equally deep: a
    force is as depth^`STIFFENING`."""
    level = np.array([press.level_pa for press in presses])
    sd = np.array([press.level_sd_pa for press in presses])
    if (usual_m := usual_depth_m(presses)) is None:
        return level, sd
    deeper = np.log(usual_m / _depths_m(presses))
    by = np.exp(STIFFENING * deeper)
    return by * level, by * np.hypot(sd, STIFFENING_SD * deeper * level)


def in_words(presses: Sequence[Press]) -> str | None:
    """What a reader of levels must know of their depths; None where all are equal."""
    judged = [press for press in presses if press.pulse is not None]
    if (usual_m := usual_depth_m(judged)) is None:
        return None
    low_mm, high_mm = 1e3 * _depths_m(judged).min(), 1e3 * _depths_m(judged).max()
    return (
        f"the presses are {low_mm:.2f} to {high_mm:.2f} mm deep, so stiffness is compared as if "
        f"all were {1e3 * usual_m:.2f} mm deep"
    )


def _depths_m(presses: Sequence[Press]) -> Array:
    return np.array([press.station.hold_depth_m for press in presses])
