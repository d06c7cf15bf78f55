"""A straight move that a controller gets in segments, so that it never knows far ahead.

A controller that has been told a whole press finishes it, whatever becomes of the program. One that
gets the way bit by bit, while somebody watches, comes to rest by itself when nobody does.
"""

import math

Place = tuple[float, float, float]

SEGMENT_S = 0.05
"""A segment lasts this long. Halved or doubled, the bound changes by nothing: `AHEAD_S` is it."""
AHEAD_S = 0.15
"""How long a controller goes on by itself, beside the time between two reports and its braking.

Less would make a ramp uneven: a segment (50 ms), a report's way (up to 40 ms) and a busy computer's
pauses (60 ms are left) come from it."""

RESTS_S = 0.3
"""Rest on the way for so long is no late segment: twice `AHEAD_S`."""


class SegmentedMove:
    """The way from ``start`` to ``target`` [mm] at ``speed_mm_s``.

    `next` gives the controller at most ``ahead_mm`` more than where it was last seen, in segments
    of at least ``shortest_mm``; an infinite ``ahead_mm`` gives the whole move at once.
    """

    def __init__(
        self,
        start: Place,
        target: Place,
        speed_mm_s: float,
        *,
        ahead_mm: float,
        shortest_mm: float = 0.0,
    ) -> None:
        self.start, self.target, self.speed_mm_s = start, target, speed_mm_s
        self.shortest_mm = shortest_mm
        self.length_mm = math.dist(start, target)
        self.given_mm = 0.0
        self._segment_mm = max(SEGMENT_S * speed_mm_s, shortest_mm)
        longest_mm = self.length_mm + self._segment_mm
        self._ahead_mm = min(max(ahead_mm, 2 * self._segment_mm), longest_mm)

    @property
    def whole(self) -> bool:
        """Whether the controller knows all of it."""
        return self.given_mm >= self.length_mm

    def way_mm(self, place: Place) -> float:
        """How far along the move a place is."""
        if self.length_mm == 0.0:
            return 0.0
        along = ((p - s) * (t - s) for p, s, t in zip(place, self.start, self.target, strict=True))
        return sum(along) / self.length_mm

    def next(self, seen: Place) -> Place | None:
        """Where to go on to from what it knows, seen at ``seen``; None if it knows enough."""
        room_mm = self.way_mm(seen) + self._ahead_mm - self.given_mm
        if self.whole or room_mm < self._segment_mm:
            return None
        # the first order is all that it may know: no segment may be late while it sets off
        segments = 1 if self.given_mm else room_mm // self._segment_mm
        to_mm = self.given_mm + segments * self._segment_mm
        if to_mm > self.length_mm - self._segment_mm / 2:  # no crumb at the end
            self.given_mm = self.length_mm
            return self.target
        self.given_mm = to_mm
        share = to_mm / self.length_mm
        x, y, z = (s + share * (t - s) for s, t in zip(self.start, self.target, strict=True))
        return (x, y, z)
