"""What else a map of presses at any places may show than a spot: a level higher on one side."""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.bumps import TRUSTED
from probe.detection.map.field import SPOT_UNKNOWNS, Map, Spot, weighted
from probe.detection.map.row_rivals import MAX_LOG_ODDS, STEP_WIDTHS, explained

DIRECTIONS = 12
"""In which a step is tried, over half a turn: none is more than 7.5 degrees off, which moves it by
half the distance between presses at the rim of a map that is eight of them wide."""


def odds_of_a_step(seen: Map, spots: list[Spot], spot: Spot) -> float:
    """Odds that the map is higher on one side, as over a bone's edge, instead of ``spot``, one of
    its ``spots``, or of all of them, alike beforehand: by likelihood, each unknown less for half
    the logarithm of the presses (Schwarz 1978). A step has as many unknowns as a spot."""
    known = [np.append(one.place_m, one.half_width_m) for one in spots]
    rest = [k for k, one in zip(known, spots, strict=True) if one is not spot]
    n = len(seen.value)
    *_, left = weighted(seen, known)
    rss = float(left @ left)
    dof = max(n - seen.base.shape[1] - SPOT_UNKNOWNS * len(known), 1)
    scatter = max((rss + TRUSTED) / (dof + TRUSTED), 1.0)
    steps, best = _steps(seen) / seen.sd[:, None], -np.inf
    for others in [rest, []] if rest else [rest]:
        _, a, _, left = weighted(seen, others)
        after = float(left @ left) - explained(a, left, steps).max()
        fewer = SPOT_UNKNOWNS * (len(rest) - len(others))
        best = max(best, (rss - after) / (2 * scatter) + fewer * np.log(n) / 2)
    return float(np.exp(min(best, MAX_LOG_ODDS)))


def _steps(seen: Map) -> Array:
    """Columns (m, n, 1) of steps in every direction, from anywhere in the map or just beyond it to
    anywhere on a scale of `STEP_WIDTHS`."""
    unit, columns = seen.spacing_m, []
    for angle in np.pi / DIRECTIONS * np.arange(DIRECTIONS):
        along = seen.place_m @ np.array([np.cos(angle), np.sin(angle)])
        middles = np.arange(along.min() - unit, along.max() + 1.5 * unit, unit / 2)
        widths = unit * np.array(STEP_WIDTHS)[:, None, None]
        columns.append(np.tanh((along - middles[:, None]) / widths).reshape(-1, len(along), 1))
    return np.concatenate(columns)
