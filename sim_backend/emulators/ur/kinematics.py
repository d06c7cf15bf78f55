"""The joint angles of a UR5e, in closed form.

Denavit-Hartenberg parameters: Universal Robots, "DH parameters for calculations of kinematics and
dynamics". Inverse: R. Keating, "UR5 inverse kinematics", Johns Hopkins University, 2014.
"""

import math
from collections.abc import Callable
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from sim_backend.arrays import Array

Six = tuple[float, float, float, float, float, float]
Inverse = Callable[[Six, Six, Six], Six | None]
"""Joint angles [rad] of a tool's pose, of a tool on the flange, near given ones; None: no way."""
D1, A2, A3, D4, D5, D6 = 0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996
LINKS = (
    (D1, 0.0, math.pi / 2), (0.0, A2, 0.0), (0.0, A3, 0.0),
    (D4, 0.0, math.pi / 2), (D5, 0.0, -math.pi / 2), (D6, 0.0, 0.0),
)  # fmt: skip
"""d [m], a [m] and alpha of each joint."""
STRAIGHT = 1e-9  # sine of the wrist's angle below which joint 6 can be anything
FULL_TURN_RAD = 2 * math.pi
POSTURE: Six = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)


def anywhere(_pose: Six, _tcp: Six, _near: Six) -> Six | None:
    """An arm that never ends, always in its best posture."""
    return POSTURE


def flange(joints: Six) -> Array:
    """Flange (4, 4) in the base frame for joint angles (6,) [rad]."""
    placed = np.eye(4)
    for number, angle in enumerate(joints):
        placed = placed @ _link(number, angle)
    return placed


def ur5e(pose: Six, tcp: Six, near: Six) -> Six | None:
    """See `Inverse`; poses in m and rotation vector, ``pose`` in the base frame."""
    solutions = _all(_matrix(pose) @ np.linalg.inv(_matrix(tcp)), near[5])
    if not solutions:
        return None
    wound = np.array(solutions)
    wound += FULL_TURN_RAD * np.round((np.array(near) - wound) / FULL_TURN_RAD)
    a, b, c, d, e, f = wound[np.argmin(np.abs(wound - near).max(axis=1))].tolist()
    return (a, b, c, d, e, f)


def _matrix(pose: Six) -> Array:
    placed = np.eye(4)
    placed[:3, :3] = Rotation.from_rotvec(pose[3:]).as_matrix()
    placed[:3, 3] = pose[:3]
    return placed


def _link(number: int, angle: float) -> Array:
    d, a, alpha = LINKS[number]
    c, s, ca, sa = math.cos(angle), math.sin(angle), math.cos(alpha), math.sin(alpha)
    return np.array(
        [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    )


def _all(goal: Array, sixth: float) -> list[list[float]]:
    """Up to eight solutions; ``sixth`` stands where joint 6 is free."""
    found = []
    inverse = np.linalg.inv(goal)
    wrist = goal @ np.array([0.0, 0.0, -D6, 1.0])
    away = math.hypot(wrist[0], wrist[1])
    if away < D4:
        return []
    for left, up, elbow in product((1, -1), (1, -1), (1, -1)):
        one = math.atan2(wrist[1], wrist[0]) + left * math.acos(D4 / away) + math.pi / 2
        s1, c1 = math.sin(one), math.cos(one)
        lean = (goal[0, 3] * s1 - goal[1, 3] * c1 - D4) / D6
        five = up * math.acos(max(-1.0, min(lean, 1.0)))
        s5 = math.sin(five)
        six = sixth
        if abs(s5) > STRAIGHT:
            six = math.atan2((-inverse[1, 0] * s1 + inverse[1, 1] * c1) / s5,
                             (inverse[0, 0] * s1 - inverse[0, 1] * c1) / s5)  # fmt: skip
        after = _link(4, five) @ _link(5, six)
        fourth = np.linalg.inv(_link(0, one)) @ goal @ np.linalg.inv(after)
        x, y = (fourth @ np.array([0.0, -D4, 0.0, 1.0]))[:2]
        cosine = (x * x + y * y - A2 * A2 - A3 * A3) / (2 * A2 * A3)
        if abs(cosine) > 1:
            continue
        three = elbow * math.acos(cosine)
        two = math.atan2(-y, -x) - math.asin(-A3 * math.sin(three) / math.hypot(x, y))
        last = np.linalg.inv(_link(1, two) @ _link(2, three)) @ fourth
        found.append([one, two, three, math.atan2(last[1, 0], last[0, 0]), five, six])
    return found
