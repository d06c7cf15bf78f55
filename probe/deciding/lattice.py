"""The stations of a row or grid, coarsest first: each level halves the gaps of the one before."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from probe.detection.repeats import MIN_NAMED
from probe.planning.plan import Place

COLUMNS = MIN_NAMED - 1
"""Gaps of the coarsest row: of fewer stations detection names nothing."""
ROWS = 2
"""Gaps between the coarsest rows of a grid: its ends and its middle."""


class Lattice:
    """Places by column and row; each may have several stations (``scan.repeats``)."""

    def __init__(self, places: Sequence[Place]) -> None:
        self.places = places
        self._x_m = np.unique([round(place.x_m, 9) for place in places])
        self._y_m = np.unique([round(place.y_m, 9) for place in places])
        self._at = [self._cell(place.x_m, place.y_m) for place in places]

    def levels(self) -> Iterator[list[Place]]:
        """The stations of each level, those of the levels before it among them, until all are."""
        halved = 1
        while True:
            columns = _spread(len(self._x_m), COLUMNS * halved)
            rows = _spread(len(self._y_m), ROWS * halved)
            level = [
                place
                for place, (i, j) in zip(self.places, self._at, strict=True)
                if i in columns and j in rows
            ]
            yield level
            if len(level) == len(self.places):
                return
            halved *= 2

    def beside(self, points_m: Iterable[tuple[float, float]]) -> list[Place]:
        """The stations nearest to each point (x, y) [m], and their neighbours."""
        wanted: set[tuple[int, int]] = set()
        for i, j in (self._cell(x_m, y_m) for x_m, y_m in points_m):
            wanted |= {(i, j), (i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)}
        return [place for place, at in zip(self.places, self._at, strict=True) if at in wanted]

    def _cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        return int(np.argmin(np.abs(self._x_m - x_m))), int(np.argmin(np.abs(self._y_m - y_m)))


def _spread(count: int, gaps: int) -> set[int]:
    """As many of ``count`` as leave ``gaps`` between them, spread evenly; at most all."""
    return set(np.round(np.linspace(0, count - 1, min(gaps + 1, count))).astype(int).tolist())
