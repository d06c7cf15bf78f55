"""What the arm's joints would have to do is known before anything moves."""

import math
from itertools import pairwise

import numpy as np
import pytest
from emulated_ur import connected
from scipy.spatial.transform import Rotation

from drivers import Pose
from drivers.ur.joints import AT_LIMIT, IN_LINE, OUT_OF_REACH, OUTSTRETCHED, hindrances
from sim_backend.emulators.ur.kinematics import D4, POSTURE, Six, flange, ur5e
from sim_backend.phantom.phantom import Respond

NO_TOOL: Six = (0.0,) * 6
ROW = [Pose(4e-3 * n, 0.0, z) for n in range(1, 5) for z in (0.002, -0.002)]


def pose_of(joints: Six) -> Six:
    placed = flange(joints)
    x, y, z = placed[:3, 3].tolist()
    rx, ry, rz = Rotation.from_matrix(placed[:3, :3]).as_rotvec().tolist()
    return (x, y, z, rx, ry, rz)


class Ur5e:
    """The library's answers, of an arm whose joints turn 360 degrees either way."""

    def isPoseWithinSafetyLimits(self, pose: list[float]) -> bool:
        return self.getInverseKinematics(pose, []) != []

    def getInverseKinematics(self, pose: list[float], near: list[float]) -> list[float]:
        a, b, c, d, e, f = pose
        g, h, i, j, k, m = near or POSTURE
        return list(ur5e((a, b, c, d, e, f), NO_TOOL, (g, h, i, j, k, m)) or [])

    def isJointsWithinSafetyLimits(self, joints: list[float]) -> bool:
        return max(map(abs, joints)) <= 2 * math.pi


def test_the_emulated_arm_s_joints_put_the_flange_where_it_was_asked_to_be() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        a, b, c, d, e, f = rng.uniform(-3.0, 3.0, 6).tolist()
        found = ur5e(pose_of((a, b, c, d, e, f)), NO_TOOL, (a, b, c, d, e, f))
        assert found is not None
        assert flange(found) == pytest.approx(flange((a, b, c, d, e, f)), abs=1e-9)


@pytest.mark.parametrize("joints, why", [
    (POSTURE, ""),
    ((0.0, -1.57, 1.57, -1.57, math.radians(-4.0), 0.0), IN_LINE),
    ((0.0, -1.2, math.radians(4.0), -1.57, -1.57, 0.0), OUTSTRETCHED),
], ids=["usual", "wrist", "elbow"])  # fmt: skip
def test_a_singular_posture_is_reported_by_name(joints: Six, why: str) -> None:
    assert hindrances(Ur5e(), [pose_of(joints)], 0.1) == [why]


def test_a_way_from_above_the_base_is_too_fast_for_a_joint() -> None:
    """Nearer to the base's axis than joint 4 is to the arm's plane the flange cannot go at all."""
    down = (0.0, math.pi, 0.0)
    way = [(x, 0.0, 0.5, *down) for x in np.arange(D4 + 2e-4, 0.16, 4e-3)]
    whys = hindrances(Ur5e(), way, 0.1)
    assert whys[1] == "joint 1 would turn by 11 degrees on 4.0 mm (near a singularity)"
    assert whys[-1] == ""
    assert hindrances(Ur5e(), way, 0.02) == [""] * len(way)


@pytest.mark.parametrize("origin_mm, limit_deg, why", [
    ((400.0, -20.0, 150.0), 360.0, None),
    ((400.0, -20.0, 150.0), 80.0, AT_LIMIT),
    ((930.0, -20.0, 150.0), 360.0, OUT_OF_REACH),
], ids=["usual", "joint limit", "reach"])  # fmt: skip
def test_a_row_is_judged_by_its_joints_before_moving(
    winkler: Respond, origin_mm: tuple[float, ...], limit_deg: float, why: str | None
) -> None:
    emulated = {"origin_mm": origin_mm, "inverse": ur5e, "joint_limit_deg": limit_deg}
    with connected(winkler, keys={"origin_mm": origin_mm, "answer_s": 60.0}, **emulated) as made:
        made.stage.enable()
        before = made.tip_m
        found = made.stage.unreachable(ROW)
        assert set(found.values()) == (set() if why is None else {why})
        assert len(found) == (0 if why is None else len(ROW))
        assert made.tip_m == before


def test_neighbours_of_a_row_need_little_of_the_joints() -> None:
    """What the rule allows is far from what a row needs: it does not refuse ordinary rigs."""
    down = (0.0, math.pi, 0.0)
    near, turned = POSTURE, []
    for x in np.arange(0.35, 0.42, 0.004):
        found = ur5e((float(x), -0.1, 0.15, *down), NO_TOOL, near)
        assert found is not None
        turned.append(near := found)
    assert max(np.abs(np.subtract(b, a)).max() for a, b in pairwise(turned)) < 0.05
