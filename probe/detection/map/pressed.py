"""Presses that could be judged, as maps of level and pulse: along a row, or over an area."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from drivers.core.arrays import Array
from probe.detection.map.area import map_of
from probe.detection.map.row_shapes import floor, surroundings
from probe.detection.map.seen_map import Map, row_of
from probe.detection.pulse.presses import Press
from probe.detection.pulse.search import Search
from probe.detection.repeats import places_of
from probe.detection.unequal_depths import levels_at_one_depth

BEAT_SCATTER = 0.08
"""What a heart's pulses differ by from press to press, over the largest."""


@dataclass(frozen=True)
class Pressed:
    """Levels and pulses (n,) with their standard deviations at places (n, d), of a row in order of
    x; ``searches`` are those of each place. ``depth_m`` is the median press's, 0 where depths were
    not recorded; levels are those at one depth."""

    place_m: Array
    level_pa: Array
    level_sd_pa: Array
    pulse_pa: Array
    pulse_sd_pa: Array
    searches: tuple[tuple[Search, ...], ...]
    depth_m: float

    @property
    def x_m(self) -> Array:
        return self.place_m[:, 0]

    @property
    def is_row(self) -> bool:
        return bool(self.place_m.shape[1] == 1)

    def levels(self, base: Array | None = None) -> Map:
        """The map of its levels; of a row over the columns ``base`` (n, k), by default
        `surroundings`."""
        if not self.is_row:
            return map_of(self.place_m, self.level_pa, self.level_sd_pa)
        base = surroundings(self.x_m) if base is None else base
        return row_of(self.x_m, self.level_pa, self.level_sd_pa, base)

    def pulses(self) -> Map:
        """The map of its pulses, as uncertain as a heart's beats differ and at least as the usual
        press is: a hold shorter than a beat may say too little doubt."""
        own_pa = np.maximum(self.pulse_sd_pa, np.median(self.pulse_sd_pa))
        sd_pa = np.hypot(own_pa, BEAT_SCATTER * self.pulse_pa.max())
        if self.is_row:
            return row_of(self.x_m, self.pulse_pa, sd_pa, floor(self.x_m))
        return map_of(self.place_m, self.pulse_pa, sd_pa, curved=False)


def in_row(presses: Sequence[Press]) -> Pressed:
    """Those of one row, in order of x; repeats at one place (`places_of`) are averaged."""
    judged = sorted(
        (p for p in presses if p.pulse is not None and np.isfinite(p.station.x_m)),
        key=lambda p: p.station.x_m,
    )
    place = places_of(np.array([p.station.x_m for p in judged]))
    groups = [[p for p, at in zip(judged, place, strict=True) if at == k] for k in np.unique(place)]
    x_m = np.array([np.mean([p.station.x_m for p in group]) for group in groups])
    return _pressed(x_m.reshape(-1, 1), groups)


def over_area(presses: Sequence[Press]) -> Pressed:
    """Those of known x and y."""
    judged = [
        p for p in presses
        if p.pulse is not None and np.isfinite([p.station.x_m, p.station.y_m]).all()
    ]  # fmt: skip
    place_m = np.array([(p.station.x_m, p.station.y_m) for p in judged]).reshape(-1, 2)
    return _pressed(place_m, [[p] for p in judged])


def _pressed(place_m: Array, groups: list[list[Press]]) -> Pressed:
    """Of presses at each place."""
    values = []
    levels_pa = iter(zip(*levels_at_one_depth([p for group in groups for p in group]), strict=True))
    for group in groups:
        pulses = [p.pulse for p in group if p.pulse is not None]
        own_pa, own_sd_pa = zip(*islice(levels_pa, len(group)), strict=True)
        values.append((
            *_mean(list(own_pa), list(own_sd_pa)),
            *_mean([pulse.size_pa for pulse in pulses], [pulse.size_sd_pa for pulse in pulses]),
        ))  # fmt: skip
    searches = tuple(
        tuple(p.pulse.search for p in group if p.pulse and p.pulse.search) for group in groups
    )
    depths_m = [p.station.hold_depth_m for group in groups for p in group]
    depth_m = float(np.nan_to_num(np.median(depths_m))) if depths_m else 0.0
    level, level_sd, size, size_sd = np.array(values).reshape(-1, 4).T
    return Pressed(place_m, level, level_sd, size, size_sd, searches, depth_m)


def _mean(value: list[float], sd: list[float]) -> tuple[float, float]:
    """Mean weighted by variance, and its standard deviation."""
    if len(value) == 1:
        return value[0], sd[0]
    weight = 1 / np.maximum(sd, 1e-12) ** 2
    return float(weight @ value / weight.sum()), float(weight.sum() ** -0.5)
