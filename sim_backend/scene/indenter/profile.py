"""The outline of a rigid finger: a convex line, rounded, whose flanks rise straight."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array

RIGID_DEG = 2.0
"""Arc of an `Profile.outline` per element."""
FLAT_ELEMENTS = 20
"""Elements of an `Profile.outline` per straight part."""
STEEPEST_DEG = 88.0
"""Where an `Profile.outline` ends: beyond it rises upright."""


@dataclass(frozen=True)
class Profile:
    """All points within ``radius`` [m] of a core, mirrored or turned about the axis r = 0.

    ``core`` are the corners (r, h) [m] of its lower side from (0, 0) outwards, convex; from the
    last one it rises upright. A cylinder's core has one corner, a flat finger's two.
    """

    core: tuple[tuple[float, float], ...]
    radius: float

    @property
    def half_width(self) -> float:
        """[m]"""
        return self.core[-1][0] + self.radius

    @property
    def height(self) -> float:
        """From the lowest point to where the flanks rise upright [m]."""
        return self.core[-1][1] + self.radius

    @property
    def scale(self) -> float:
        """Length [m] that elements under the finger scale with: half of its width; of a pointed
        one the geometric mean of that and of its point's radius, which for a cylinder are one."""
        pointed = len(self.core) > 1 and self.core[1][1] > 0
        return float(np.sqrt(self.radius * self.half_width)) if pointed else self.half_width

    @property
    def rounding(self) -> tuple[float, float] | None:
        """From where to where [m] the edge of a flat face is rounded; None without a face."""
        return (self.core[-1][0], self.half_width) if self.chord(0.0) > 0 else None

    def gap(self, r: Array, h: Array) -> tuple[Array, Array, Array]:
        """Gap (n,) [m] to points at ``r`` >= 0, ``h`` above the lowest point (n,) [m]; its gradient
        (n, 2) by both; and the curvature (n,) [1/m] at which that turns along the finger.

        Within the core, deeper than any contact goes, it is the gap to the underside.
        """
        point = np.stack([r, h - self.radius], axis=1)
        corners = self._corners
        foot = np.stack([np.full(len(r), corners[-1, 0]), np.maximum(point[:, 1], corners[-1, 1])],
                        axis=1)  # fmt: skip
        flat = point[:, 1] > corners[-1, 1]
        distance = np.hypot(*(point - foot).T)
        inside, deepest = r <= corners[-1, 0], np.full(len(r), -np.inf)
        face = np.tile([0.0, -1.0], (len(r), 1))
        for start, way, normal in zip(corners, self._ways, self._normals, strict=False):
            share = np.clip((point - start) @ way / (way @ way), 0.0, 1.0)
            nearest = start + share[:, None] * way
            away = np.hypot(*(point - nearest).T)
            nearer = away < distance
            distance = np.where(nearer, away, distance)
            foot = np.where(nearer[:, None], nearest, foot)
            flat = np.where(nearer, (share > 0) & (share < 1), flat)
            out = (point - start) @ normal
            face = np.where((out > deepest)[:, None], normal, face)
            deepest, inside = np.maximum(deepest, out), inside & (out <= 0)
        if len(corners) == 1:
            inside, deepest = (distance == 0) & inside, np.zeros(len(r))
        safe = np.maximum(distance, 1e-12)
        gradient = np.where(inside[:, None], face, (point - foot) / safe[:, None])
        gap = np.where(inside, deepest, distance) - self.radius
        return gap, gradient, np.where(inside | flat, 0.0, 1 / safe)

    def chord(self, depth: float) -> float:
        """Half of the width [m] at ``depth`` [m] above the lowest point; at 0 that of a face."""
        return self._to(depth)[0]

    def arc(self, depth: float) -> float:
        """Length [m] of the outline from its middle to ``depth`` [m] above the lowest point."""
        return self._to(depth)[1]

    def sinks(self, lean: float) -> float:
        """How far the lowest point lies below the middle of the underside [m] if it leans [rad]."""
        r, h = self._corners.T
        level = (h + self.radius) * np.cos(lean) - r * abs(np.sin(lean))
        return float(self.radius - level.min())

    def outline(self) -> Array:
        """The underside (2n + 1, 2) [m] from left to right, its lowest height 0: ends and middles
        of n elements."""
        half = [np.zeros((1, 2))]
        angles = np.minimum(self._angles, np.radians(STEEPEST_DEG))
        for n, (corner, first, last) in enumerate(
            zip(self._corners, angles, angles[1:], strict=False)
        ):
            if last > first:
                count = max(1, round(float(np.degrees(last - first)) / RIGID_DEG))
                turn = np.linspace(first, last, 2 * count + 1)[1:]
                half.append(corner + self.radius * np.stack([np.sin(turn), 1 - np.cos(turn)], 1))
            if n < len(self._ways):
                share = np.linspace(0, 1, 2 * FLAT_ELEMENTS + 1)[1:, None]
                half.append(half[-1][-1] + share * self._ways[n])
        right = np.vstack(half)
        return np.vstack([right[:0:-1] * [-1, 1], right])

    def _to(self, depth: float) -> tuple[float, float]:
        """Where the outline is at a height, and its length to there."""
        height, length = min(depth, self.height), 0.0
        x = 0.0
        for n, (x0, h0) in enumerate(self._corners):
            first, last = self._angles[n : n + 2]
            cosine = np.clip(1 - (height - h0) / self.radius, np.cos(last), np.cos(first))
            turn = float(np.arccos(cosine))
            x, length = (
                x0 + self.radius * float(np.sin(turn)),
                length + self.radius * (turn - first),
            )
            at = h0 + self.radius * (1 - float(np.cos(last)))
            if height < at or n == len(self._ways):
                break
            across, up = self._ways[n]
            share = 1.0 if up <= 0 else float(np.clip((height - at) / up, 0.0, 1.0))
            x, length = x + share * across, length + share * float(np.hypot(across, up))
            if height < at + up:
                break
        return float(x), float(length)

    @cached_property
    def _corners(self) -> Array:
        """(k, 2), without those that are where the last one is: of a face that is all edge."""
        return np.array(list(dict.fromkeys(self.core)), dtype=float)

    @cached_property
    def _ways(self) -> Array:
        """From each corner to the next (k - 1, 2)."""
        return np.diff(self._corners, axis=0)

    @cached_property
    def _normals(self) -> Array:
        """Of each straight part (k - 1, 2), out of the finger."""
        across = np.stack([self._ways[:, 1], -self._ways[:, 0]], axis=1)
        return np.asarray(across / np.hypot(*self._ways.T)[:, None])

    @cached_property
    def _angles(self) -> Array:
        """To the horizontal (k + 1,): between them the outline turns at each corner."""
        return np.concatenate([[0.0], np.arctan2(*self._ways.T[::-1]), [np.pi / 2]])
