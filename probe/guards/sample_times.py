"""Whether the times of a sensor's samples can be those of the scan's clock."""

import math
from itertools import pairwise

from drivers import Block

FUTURE_S = 0.1  # a sample may be ahead of the clock; silence after it is found later by as much


class SampleTimes:
    """Of one sensor, block by block."""

    def __init__(self) -> None:
        self._last_s = -math.inf

    def check(self, block: Block, now_s: float) -> str | None:
        """Why a block with samples cannot be placed in time."""
        times: list[float] = block.time_s.tolist()
        first, last = times[0], times[-1]
        onward = all(a < b for a, b in pairwise((self._last_s, *times)))
        if not (onward and last <= now_s + FUTURE_S):  # also true for not-a-number
            before = f"{self._last_s:.4f} s, then " if math.isfinite(self._last_s) else ""
            return (
                f"sample times jump ({before}{first:.4f} to {last:.4f} s; the scan's clock says "
                f"{now_s:.4f} s); such samples are not stored"
            )
        self._last_s = last
        return None
