"""The scan frame in a robot's base frame, from three points that the tool has touched.

The first is the frame's origin, the second lies along its x axis, the third on the side of its y
axis; the plane through them is the surface, and z points out of it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calibration.errors import CalibrationError

Array = NDArray[np.float64]
MIN_SIDE_M = 10e-3
MIN_HEIGHT_M = 5e-3
MAX_TILT_DEG = 45.0
"""Of the tool against the press; beyond, the third point is more likely on the wrong side."""
DOWN = np.array([0.0, 0.0, -1.0])


class Frame(NamedTuple):
    """Where the scan frame lies: keys of ``[stage] driver = "ur"``, and how well it is known.

    ``tilt_per_mm_deg``: by how much the plane tilts if one of the points is off by 1 mm.
    """

    origin_mm: tuple[float, float, float]
    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    tilt_per_mm_deg: float

    @property
    def turn(self) -> Rotation:
        """From the scan frame to the base frame."""
        return Rotation.from_euler("xyz", self[1:4], degrees=True)


def frame_of(points_m: Array) -> Frame:
    """The frame of three points (3, 3) in the base frame.

    Raises `CalibrationError` if they are too close to each other, or in line.
    """
    origin, along, beside = points_m
    side = float(np.linalg.norm(along - origin))
    if side < MIN_SIDE_M:
        raise CalibrationError(
            f"the first two points are {1e3 * side:.1f} mm apart: the direction of x needs "
            f"{1e3 * MIN_SIDE_M:g} mm at least; take them as far apart as the scan is long"
        )
    x = (along - origin) / side
    height = float(np.linalg.norm(np.cross(x, beside - origin)))
    if height < MIN_HEIGHT_M:
        raise CalibrationError(
            f"the third point is {1e3 * height:.1f} mm beside the line through the first two: a "
            f"plane needs {1e3 * MIN_HEIGHT_M:g} mm at least; take it farther to the side of y"
        )
    z = np.cross(x, beside - origin) / height
    turn = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    roll, pitch, yaw = turn.as_euler("xyz", degrees=True).tolist()
    a, b, c = (1e3 * origin).tolist()
    tilt_deg = math.degrees(math.atan(1e-3 / min(side, height)))
    return Frame((a, b, c), roll, pitch, yaw, tilt_deg)


def tool_in(frame: Frame, tool_rotvec: Array) -> tuple[tuple[float, float, float], float]:
    """The tool's orientation in the scan frame when it presses straight, and how far it was off.

    ``tool_rotvec`` (3,): its orientation in the base frame at one of the points. It is turned by
    the least angle [degrees], which is returned too, so that its z axis presses along -z.
    Raises `CalibrationError` if that is no small turn.
    """
    tool = frame.turn.inv() * Rotation.from_rotvec(tool_rotvec)
    axis = tool.apply([0.0, 0.0, 1.0])
    tilt_deg = math.degrees(math.acos(np.clip(axis @ DOWN, -1.0, 1.0)))
    if tilt_deg > MAX_TILT_DEG:
        raise CalibrationError(
            f"the tool stands {tilt_deg:.0f} degrees from the press into these points' plane: the "
            "third point lies on the wrong side of the line (y is to the left of x, seen from "
            "the tool), or the tool was not held as it shall press"
        )
    turned, _ = Rotation.align_vectors([DOWN], [axis])
    rx, ry, rz = (turned * tool).as_rotvec().tolist()
    return (rx, ry, rz), tilt_deg
