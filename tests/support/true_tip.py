"""Where a phantom's tip truly is, whatever its stage says of it."""

import math
import time

from waiting import until

from sim_backend.phantom.phantom import Phantom


class HasTip:
    """What has a ``phantom``."""

    phantom: Phantom

    @property
    def tip_m(self) -> tuple[float, float, float]:
        return self.phantom.tip.point(self.phantom.clock.now())

    @property
    def tip_moves(self) -> bool:
        return self.phantom.tip.moving(self.phantom.clock.now())

    @property
    def deepest_m(self) -> float:
        """The lowest that it has been."""
        legs = self.phantom.tip.all_legs()
        ends_s = [*(leg.start_s for leg in legs[1:]), math.inf]
        return min(leg.point(end_s)[2] for leg, end_s in zip(legs, ends_s, strict=True))

    def rests_m(self) -> float:
        """The height at which it comes to rest, and stays."""
        until(lambda: not self.tip_moves, 5.0)
        there = self.tip_m
        time.sleep(0.2)
        assert self.tip_m == there
        return there[2]
