"""The limits of a scan, checked on what the devices report, never on what was commanded.

Pure checks: each takes a reading and returns why it may not go on, or None. `probe.watch` calls
them for every sample and acts.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers import Block, Channel, Pose
from probe.plan import Box, Surface

Array = NDArray[np.float64]

POSE_SLACK_M = 50e-6  # reported poses jitter; the workspace itself is planned with nothing beyond
POSE_AGE_S = 0.1  # drivers report a pose up to this old, and then all that was missed at once
SPEED_SLACK = 1.2  # what a pose's last digits add to the way
FUTURE_S = 0.1


@dataclass(frozen=True)
class Limits:
    """What may never be exceeded.

    ``max_depth_m`` is below the plan's surface. A device is silent after ``silence_s`` without a
    reading (at least five of a sensor's periods). ``face_m2`` turns pressure channels into force.
    """

    max_force_n: float
    max_depth_m: float
    workspace_m: Box
    max_speed_m_s: float
    silence_s: float = 0.25
    clock_jump_s: float = 0.25
    face_m2: float | None = None


@dataclass(frozen=True)
class Trip:
    """Why a guard stopped the stage. ``can_retract``: the stage itself is still trusted."""

    time_s: float
    device: str
    reason: str
    can_retract: bool


class SensorGuard:
    """Force, saturation and timestamps of one sensor's samples."""

    def __init__(self, channels: tuple[Channel, ...], limits: Limits) -> None:
        face = limits.face_m2 or math.nan
        taxels = sum(channel.role == "taxel" for channel in channels)
        gain = {"force": 1.0, "pressure": face, "taxel": face / max(taxels, 1)}
        gains = np.array([gain.get(channel.role, math.nan) for channel in channels])
        self._used = np.flatnonzero(np.isfinite(gains))
        self._gains = gains[self._used]
        self.feels = len(self._used) > 0
        self.force_n = 0.0
        self._array = taxels > 0
        self._limit_n = limits.max_force_n
        self._last_s = -math.inf

    def check_times(self, block: Block, now_s: float) -> str | None:
        """Why a block with samples cannot be placed in time."""
        first, last = float(block.time_s[0]), float(block.time_s[-1])
        onward = first > self._last_s and bool((np.diff(block.time_s) > 0).all())
        if not (onward and last <= now_s + FUTURE_S):  # also true for not-a-number
            return (
                f"sample times jump ({self._last_s:.4f} s, then {first:.4f} to {last:.4f} s); "
                "such samples are not stored"
            )
        self._last_s = last
        return None

    def check(self, block: Block) -> tuple[str, bool] | None:
        """Why a block with samples breaks a limit, and whether retracting is safe."""
        if not self.feels:
            return None
        if block.saturated[:, self._used].any():
            return "the sensor is saturated: the true force is unknown", True
        force = block.values[:, self._used] * self._gains
        if self._array:
            force = force.sum(axis=1, keepdims=True)
        self.force_n = float(force[-1, 0])
        greatest = float(np.abs(force).max())
        if not greatest <= self._limit_n:  # also true for not-a-number
            return f"force {greatest:.3f} N; the limit is {self._limit_n:g} N", True
        return None


class PoseGuard:
    """Depth, workspace and speed of the stage's reported poses."""

    def __init__(self, surface: Surface, limits: Limits) -> None:
        self._surface = surface
        self._limits = limits
        self._before: Pose | None = None
        self._way_m = 0.0
        self._since_s, self._since_m = -math.inf, 0.0

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
            return "the pose is not a number", False
        depth = self._surface(x, y) - z
        if not depth <= self._limits.max_depth_m + POSE_SLACK_M:  # also true for not-a-number
            limit_mm = 1e3 * self._limits.max_depth_m
            return f"{1e3 * depth:.3f} mm below the surface; the limit is {limit_mm:g} mm", True
        for axis, at, (low, high) in zip("xyz", pose, self._limits.workspace_m, strict=False):
            if not low - POSE_SLACK_M <= at <= high + POSE_SLACK_M:
                allowed = f"{1e3 * low:g} to {1e3 * high:g} mm"
                return f"{axis} = {1e3 * at:.3f} mm; the workspace is {allowed}", False
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


class ClockGuard:
    """A scan clock must not jump against a second one."""

    def __init__(
        self, limits: Limits, now: Callable[[], float], other: Callable[[], float]
    ) -> None:
        self._now, self._other = now, other
        self._lag_s = now() - other()
        self._limit_s = limits.clock_jump_s

    def check(self) -> tuple[str, bool] | None:
        """Why the clock cannot be trusted."""
        lag_s = self._now() - self._other()
        jump_s, self._lag_s = lag_s - self._lag_s, lag_s
        if abs(jump_s) > self._limit_s:
            return f"the clock jumped by {jump_s:+.3f} s", True
        return None
