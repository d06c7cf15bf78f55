"""What the guards have read and the engine has not fetched yet, and when each device was last seen.

Written by the guards' threads, fetched by the engine's.
"""

from collections import deque
from collections.abc import Iterable

import numpy as np

from drivers import Block, Channel, Pose

STAGE = "stage"
PUBLISH_S = 0.05  # the engine fetches samples in blocks of about this length
STAGE_CHANNELS = tuple(Channel(axis, "m") for axis in "xyz")


class Readings:
    """Blocks of samples by sensor, poses of the stage, and the time of the newest of each."""

    def __init__(self, sensors: Iterable[str]) -> None:
        self._blocks: dict[str, deque[Block]] = {name: deque() for name in sensors}
        self._poses: deque[tuple[float, float, float, float]] = deque()
        self._posed_s = -np.inf
        self.seen_s: dict[str, float] = {}

    def all_seen(self, now: float) -> None:
        """Every device counts as seen now."""
        self.seen_s = dict.fromkeys((*self._blocks, STAGE), now)

    def take(self, sensor: str, block: Block) -> None:
        """Keep a block with samples."""
        self._blocks[sensor].append(block)
        self.seen_s[sensor] = float(block.time_s[-1])

    def take_pose(self, pose: Pose, now: float) -> None:
        """Keep where the stage is; a clock that was set back says nothing of when."""
        self.seen_s[STAGE] = now
        if now > self._posed_s:
            self._posed_s = now
            self._poses.append((now, pose.x, pose.y, pose.z))

    def all_in_s(self, now: float) -> float:
        """Up to when the samples of every sensor are in; ``now`` without sensors, minus infinity
        where one has not been seen yet, as before the first move."""
        return min((self.seen_s.get(name, -np.inf) for name in self._blocks), default=now)

    def collect(self) -> list[tuple[str, Block]]:
        """All readings since the last call, one block per device that has some."""
        found = [
            (name, _joined([waiting.popleft() for _ in range(len(waiting))]))
            for name, waiting in self._blocks.items()
            if waiting
        ]
        if self._poses:
            rows = np.array([self._poses.popleft() for _ in range(len(self._poses))])
            poses = rows[:, 1:].copy()
            found.append((STAGE, Block(rows[:, 0].copy(), poses, np.zeros(poses.shape, bool))))
        return found


def _joined(blocks: list[Block]) -> Block:
    if len(blocks) == 1:
        return blocks[0]
    return Block(
        np.concatenate([b.time_s for b in blocks]),
        np.concatenate([b.values for b in blocks]),
        np.concatenate([b.saturated for b in blocks]),
        sum(b.lost for b in blocks),
        max(b.jumped_s for b in blocks),
    )
