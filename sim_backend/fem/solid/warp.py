"""Where a prism is bent: cylinders become balls."""

import numpy as np

from sim_backend.arrays import Array

BALL_CORE = (2 / 3) ** (1 / 3)
"""Radius and half length of the cylinder that becomes a ball of its volume, over its radius."""
REACH = 2.2
"""Where the bending ends at the latest, over the cylinder's radius."""


def cylinder_to_ball(points: Array, centre: Array, radius: float, room: float) -> Array:
    """``points`` (n, 3) moved so that the cylinder of radius and half length ``BALL_CORE`` times
    ``radius`` about ``centre`` becomes a ball; nothing beyond ``room`` from the axis moves.

    Along each ray from the centre the move grows evenly to the cylinder's surface and fades
    evenly beyond. At the cylinder's rims wedges come out flat on one side, at nodes only.
    """
    core = BALL_CORE * radius
    reach = min(REACH, room / core)
    off = points - centre
    level = np.maximum(np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])) / core
    distance = np.linalg.norm(off, axis=1)
    rim = distance / np.maximum(level, 1e-12)  # of the cylinder's surface on the same ray
    stretch = radius / np.maximum(rim, 1e-12) - 1
    faded = np.clip(np.where(level < 1, level, (reach - level) / (reach - 1)), 0.0, 1.0)
    moved = np.where(level > 1e-9, faded * stretch, 0.0)
    return np.asarray(points + moved[:, None] * off)
