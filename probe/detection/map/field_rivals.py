"""What else a map of presses at any places may show than a spot: a level higher on one side."""

import numpy as np

from probe.detection.map.bumps import TRUSTED
from probe.detection.map.field import SPOT_UNKNOWNS, Map, Spot, weighted
from probe.detection.map.row_rivals import least_left, odds_instead, steps

DIRECTIONS = 12
"""In which a step is tried, over half a turn: none is more than 7.5 degrees off, which moves it by
half the distance between presses at the rim of a map that is eight of them wide."""


def odds_of_a_step(seen: Map, spots: list[Spot], spot: Spot) -> float:
    """Odds that the map is higher on one side, as over a bone's edge, instead of ``spot``, one of
    its ``spots``, or of all of them; a step has as many unknowns as a spot."""
    known = [np.append(one.place_m, one.half_width_m) for one in spots]
    rest = [k for k, one in zip(known, spots, strict=True) if one is not spot]
    *_, left = weighted(seen, known)
    rss, count = float(left @ left), len(seen.value)
    dof = max(count - seen.base.shape[1] - SPOT_UNKNOWNS * len(known), 1)
    turns = np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    along_m = seen.place_m @ np.array([np.cos(turns), np.sin(turns)])
    columns = np.concatenate([steps(one, seen.spacing_m) for one in along_m.T])
    columns = columns / seen.sd[:, None]
    fits = []
    for others in (rest, []):
        _, a, _, left = weighted(seen, others)
        fewer = SPOT_UNKNOWNS * (len(rest) - len(others))
        fits.append((least_left(a, left, columns), fewer))
    return odds_instead(fits, rss, (rss + TRUSTED) / (dof + TRUSTED), count)
