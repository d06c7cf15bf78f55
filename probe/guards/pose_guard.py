"""Where the tip may be: above the depth limit, in the workspace, on its way and not at a stand."""

import math
from collections import deque

from drivers import Pose
from probe.planning.limits import ARRIVED_M, Limits
from probe.planning.surfaces import Surface

POSE_SLACK_M = 50e-6  # reported poses jitter; the workspace itself is planned with nothing beyond
POSE_AGE_S = 0.1  # drivers report a pose up to this old, and then all that was missed at once
SPEED_SLACK = 1.2  # what a pose's last digits add to the way
# How far from its straight way, and from where it was to rest, a tip may be that nobody else moves:
# five times what the engine takes for an arrival, and once that with a pose's jitter.
STILL_S, STILL_M = 2.0, 20e-6  # a move stands still; reported poses at rest jitter by this
SLOWEST_PACE = 0.01  # a slower controller is taken for one that stands
WAY_M, REST_M = 5 * ARRIVED_M, ARRIVED_M + POSE_SLACK_M


class PoseGuard:
    """Depth, workspace, way and speed of the stage's reported poses."""

    def __init__(self, surface: Surface, limits: Limits) -> None:
        self._surface = surface
        self._limits = limits
        self._before: Pose | None = None
        self._way_m = 0.0
        self._since_s, self._since_m = -math.inf, 0.0
        self._way: tuple[Pose, Pose, float] | None = None
        self._left_m = -math.inf  # of the way, at least so far

    def expect(self, start: Pose, target: Pose, *, may_go_back: bool = False) -> None:
        """From now on the tip is on its straight way between these, or at rest there; on it only
        onward, unless it ``may_go_back`` as a controller does from a contact."""
        self._way = (start, target, WAY_M)
        self._left_m = -math.inf if may_go_back else math.dist(start[:3], target[:3])

    def expect_rest(self, pose: Pose) -> None:
        """From now on the tip rests here."""
        self._way, self._left_m = (pose, pose, REST_M), -math.inf

    def check(
        self, pose: Pose, now_s: float, asked_s: float | None = None
    ) -> tuple[str, bool] | None:
        """Why a pose breaks a limit, and whether retracting is safe.

        It was asked for at ``asked_s`` (by default ``now_s``) and there at ``now_s``. A pose may be
        `POSE_AGE_S` old, so what counts is the way since any earlier pose that no allowed speed
        could have covered in the time since, and in that time before.
        """
        x, y, z = pose[:3]
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            return "the pose is not a number", True
        depth = self._surface(x, y) - z
        if not depth <= self._limits.max_depth_m + POSE_SLACK_M:  # also true for not-a-number
            limit_mm = 1e3 * self._limits.max_depth_m
            return f"{1e3 * depth:.3f} mm below the surface; the limit is {limit_mm:g} mm", True
        for axis, at, (low, high) in zip("xyz", pose, self._limits.workspace_m, strict=False):
            if not low - POSE_SLACK_M <= at <= high + POSE_SLACK_M:
                allowed = f"{1e3 * low:g} to {1e3 * high:g} mm"
                above = axis == "z" and at > high
                return f"{axis} = {1e3 * at:.3f} mm; the workspace is {allowed}", not above
        if self._way is not None:
            start, target, allowed_m = self._way
            off_m = _off_the_way(pose, start, target)
            if off_m > allowed_m:
                return f"is {1e3 * off_m:.2f} mm from where it was commanded to be", True
            left_m = math.dist(pose[:3], target[:3])
            self._left_m = min(self._left_m, left_m)
            if left_m - self._left_m > WAY_M and math.isfinite(self._left_m):
                back_mm = 1e3 * (left_m - self._left_m)
                return f"went back {back_mm:.2f} mm on its way: something else moves it", True
        return self._check_speed(pose, now_s, now_s if asked_s is None else asked_s)

    def _check_speed(self, pose: Pose, now_s: float, asked_s: float) -> tuple[str, bool] | None:
        limit_m_s = self._limits.max_speed_m_s
        if self._before is not None:
            self._way_m += math.dist(self._before[:3], pose[:3])
        self._before = pose
        way_m, within_s = self._way_m - self._since_m, now_s - self._since_s
        ahead_m = way_m - SPEED_SLACK * limit_m_s * within_s
        if way_m - SPEED_SLACK * limit_m_s * (asked_s - self._since_s) <= 0:
            self._since_s, self._since_m = asked_s, self._way_m
        if ahead_m > limit_m_s * POSE_AGE_S:
            moved = f"moved {1e3 * way_m:.1f} mm within {within_s:.2f} s"
            return f"{moved}; the limit is {1e3 * limit_m_s:g} mm/s", True
        return None


class StandStill:
    """A move that does not go on, though nobody has stopped it."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, Pose]] = deque()
        self._target: Pose | None = None
        self._speed_m_s = 0.0

    def begin(self, target: Pose, speed_m_s: float) -> None:
        """A move has been ordered."""
        self._poses.clear()
        self._target, self._speed_m_s = target, speed_m_s

    def end(self) -> None:
        """It is over, or was stopped."""
        self._target = None

    def check(self, pose: Pose, now_s: float) -> str | None:
        """Why the move is not under way any more, if it is not.

        For `STILL_S`, or as long as the way takes that an arrival may lack, the tip has gone less
        than `SLOWEST_PACE` of what was commanded.
        """
        if self._target is None or math.dist(pose[:3], self._target[:3]) <= ARRIVED_M:
            self._poses.clear()
            return None
        window_s = max(STILL_S, 2 * ARRIVED_M / self._speed_m_s)
        self._poses.append((now_s, pose))
        while len(self._poses) > 1 and self._poses[1][0] <= now_s - window_s:
            self._poses.popleft()
        since_s, then = self._poses[0]
        if since_s > now_s - window_s:
            return None
        least_m = max(SLOWEST_PACE * self._speed_m_s * window_s, STILL_M)
        if math.dist(then[:3], pose[:3]) >= least_m:
            return None
        left_mm = 1e3 * math.dist(pose[:3], self._target[:3])
        return f"has stood still for {window_s:.3g} s in a move, {left_mm:.2f} mm from its target"


def _off_the_way(pose: Pose, start: Pose, target: Pose) -> float:
    """Distance [m] of a pose from the straight line between two others."""
    (x, y, z), (from_x, from_y, from_z), (to_x, to_y, to_z) = pose[:3], start[:3], target[:3]
    u, v, w = to_x - from_x, to_y - from_y, to_z - from_z
    length2 = u * u + v * v + w * w
    along = u * (x - from_x) + v * (y - from_y) + w * (z - from_z)
    share = min(max(along / length2, 0.0), 1.0) if length2 else 0.0
    return math.dist((x, y, z), (from_x + share * u, from_y + share * v, from_z + share * w))
