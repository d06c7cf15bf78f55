"""A stop is what is seen: each way to stop has its time, and then the next one is taken."""

import math
from collections.abc import Sequence

from drivers.core.abilities import StopMeans

STOP_AGAIN_S = 0.02  # a stop is repeated this often
SEEN_S = 0.03  # a tip that has not moved for so long is seen at rest: see `retreat.STILL_M`
# Between two looks no more than this counts against a means: while the whole program paused,
# nobody could see whether the stage had obeyed.
LOOK_S = 0.05


class Stopping:
    """The table of a stage's `StopMeans`, and which of them has to work now.

    Parameters
    ----------
    means
        As `drivers.core.abilities.stop_means`.
    """

    def __init__(self, means: Sequence[StopMeans]) -> None:
        self._means = means
        self._index = 0
        self._waited_s = 0.0
        self._looked_s: float | None = None
        self._ordered_s = -math.inf

    @property
    def unheeded(self) -> tuple[str, ...]:
        """The names of the means that were not seen to work."""
        return tuple(means.name for means in self._means[: self._index])

    @property
    def name(self) -> str:
        """Of the means that has to work now."""
        return self._means[self._index].name

    @property
    def lifts(self) -> bool:
        """Whether the stage can be moved after what it was stopped by."""
        return self._means[self._index].lifts

    def order(self, now_s: float, *, seen: bool) -> None:
        """The tip is not at rest, or not ``seen`` (no pose came): stop it by the means that has to
        work now."""
        if self._looked_s is not None:
            self._waited_s += min(now_s - self._looked_s, LOOK_S)
        self._looked_s = now_s
        if self._waited_s > self._means[self._index].within_s + SEEN_S:
            following = self._means[self._index + 1 :]
            if following and (seen or following[0].lifts):
                self._take(self._index + 1)
        if now_s - self._ordered_s >= STOP_AGAIN_S:
            self._ordered_s = now_s
            self._means[self._index].call()

    def worked(self) -> None:
        """The tip was seen at rest: the next stop begins with this means, and with its time."""
        self._looked_s, self._waited_s = None, 0.0

    def exhaust(self) -> None:
        """Nobody will look any more: order all means that are left, the last one last."""
        for index in range(self._index + 1, len(self._means)):
            self._take(index)
            self._means[index].call()

    def _take(self, index: int) -> None:
        self._index, self._waited_s, self._ordered_s = index, 0.0, -math.inf
