"""Where a planned pose would take the arm's joints, as its controller computes them."""

import math
from collections.abc import Sequence
from typing import Any

ELBOW, WRIST = 2, 4
SINGULAR = math.sin(math.radians(5.0))
"""Sine of the elbow's or wrist's angle: below, other joints turn eleven times as fast as usual."""
MAX_JOINT_RAD_S = math.radians(120.0)
"""The slowest joints of the family: base and shoulder of a UR10e (its data sheet)."""
OUT_OF_REACH = "out of reach, or beyond its safety limits"
AT_LIMIT = "a joint would be beyond its limit"
OUTSTRETCHED = "the arm would be outstretched, or folded up (elbow singularity)"
IN_LINE = "joints 4 and 6 would be in line (wrist singularity): turn the tool, or move the rig"

Pose = Sequence[float]


def hindrances(control: Any, poses: Sequence[Pose], max_speed_m_s: float) -> list[str]:
    """Why the arm may not go to each of ``poses`` (base frame), which it visits in this order;
    empty where it may. Nothing moves: the controller is asked."""
    found: list[str] = []
    before: Pose | None = None
    joints: Sequence[float] = ()
    for pose in poses:
        last, joints = joints, ()
        if not control.isPoseWithinSafetyLimits(list(pose)):
            found.append(OUT_OF_REACH)
            continue
        joints = control.getInverseKinematics(list(pose), list(last))
        why = _hindrance(control, joints)
        if not why and last and before is not None:
            why = _too_fast(last, joints, before, pose, max_speed_m_s)
        found.append(why)
        before = pose
    return found


def _hindrance(control: Any, joints: Sequence[float]) -> str:
    if len(joints) == 0:
        return OUT_OF_REACH
    if not control.isJointsWithinSafetyLimits(list(joints)):
        return AT_LIMIT
    if abs(math.sin(joints[ELBOW])) < SINGULAR:
        return OUTSTRETCHED
    if abs(math.sin(joints[WRIST])) < SINGULAR:
        return IN_LINE
    return ""


def _too_fast(
    last: Sequence[float], joints: Sequence[float], before: Pose, pose: Pose, max_speed_m_s: float
) -> str:
    """On a straight way between the two, beside what the tool itself turns."""
    takes_s = math.dist(before[:3], pose[:3]) / max_speed_m_s
    turns_rad = _angle_rad(before[3:], pose[3:])
    for number, (a, b) in enumerate(zip(last, joints, strict=True), start=1):
        if abs(b - a) - turns_rad > MAX_JOINT_RAD_S * takes_s:
            return (
                f"joint {number} would turn by {math.degrees(abs(b - a)):.0f} degrees on "
                f"{1e3 * math.dist(before[:3], pose[:3]):.1f} mm (near a singularity)"
            )
    return ""


def _angle_rad(one: Sequence[float], other: Sequence[float]) -> float:
    """Between two orientations (rotation vectors, which are not unique), by their quaternions."""
    dot = sum(a * b for a, b in zip(_quaternion(one), _quaternion(other), strict=True))
    return 2 * math.acos(min(abs(dot), 1.0))


def _quaternion(rotvec: Sequence[float]) -> tuple[float, ...]:
    angle = math.hypot(*rotvec)
    share = math.sin(angle / 2) / angle if angle > 0 else 0.5
    return (math.cos(angle / 2), *(share * v for v in rotvec))
