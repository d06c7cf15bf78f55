"""What else a map of presses at any places may show than a spot: a step, or a ridge across it."""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.bumps import TRUSTED
from probe.detection.map.field import SPOT_UNKNOWNS, Map, Spot, weighted
from probe.detection.map.row_rivals import STEP_WIDTHS, least_left, odds_instead, steps
from probe.detection.map.row_shapes import shape

DIRECTIONS = 24
"""In which a rival is tried, over half a turn: none is more than 3.8 degrees off, which moves it by
a quarter of the distance between presses at the rim of a map that is eight of them wide."""


def odds_of_a_straight_rise(seen: Map, spots: list[Spot], spot: Spot) -> float:
    """Odds that the map is higher on one side, as over a bone's edge, or along a straight line, as
    over a bone itself, instead of ``spot``, one of its ``spots``, or of all of them. Either has as
    many unknowns as a spot."""
    known = [np.append(one.place_m, one.half_width_m) for one in spots]
    rest = [k for k, one in zip(known, spots, strict=True) if one is not spot]
    *_, left = weighted(seen, known)
    rss, count = float(left @ left), len(seen.value)
    dof = max(count - seen.base.shape[1] - SPOT_UNKNOWNS * len(known), 1)
    turns = np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    along_m = seen.place_m @ np.array([np.cos(turns), np.sin(turns)])
    rises = [rise(one, seen.spacing_m) for one in along_m.T for rise in (steps, _ridges)]
    columns = np.concatenate(rises) / seen.sd[:, None]
    fits = []
    for others in (rest, []):
        _, a, _, left = weighted(seen, others)
        fewer = SPOT_UNKNOWNS * (len(rest) - len(others))
        fits.append((least_left(a, left, columns), fewer))
    return odds_instead(fits, rss, (rss + TRUSTED) / (dof + TRUSTED), count)


def _ridges(along_m: Array, pitch_m: float) -> Array:
    """Columns (m, n, 1) of ridges across ``along_m`` (n,), as wide and at such places as `steps`:
    of one that is cut short by a corner only its end shows, as a spot would."""
    middles_m = np.arange(along_m.min() - pitch_m, along_m.max() + 1.5 * pitch_m, pitch_m / 2)
    half_widths_m = pitch_m * np.array(STEP_WIDTHS)[:, None, None]
    return shape(along_m, middles_m[:, None], half_widths_m).reshape(-1, len(along_m), 1)
