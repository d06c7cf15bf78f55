"""What lies under one row of stations: the bumps of its level and pulse maps, put together."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from drivers.core.arrays import Array
from probe.core.finding_words import AT_AN_END, NORMAL_95
from probe.detection.classify.kinds import SIZES, Judged, Seen, judge
from probe.detection.finding import ObjectFinding
from probe.detection.map.bumps import (
    MAX_OBJECTS,
    MIN_DISTANCE,
    MIN_STATIONS,
    Bump,
    at_places,
    find_bumps,
)
from probe.detection.map.row_shapes import floor, shape, surroundings
from probe.detection.map.seen_map import Map, row_of
from probe.detection.map.sideways import reach_inwards_m
from probe.detection.pulse.pooled_evidence import hidden
from probe.detection.pulse.presses import Press
from probe.detection.pulse.search import Search
from probe.detection.repeats import pitch_m, places_of

ONE_SIGMA = 0.683
BEAT_SCATTER = 0.08
"""What a heart's pulses differ by from press to press, over the largest."""
TAIL = 2.0
"""Pulses 16 to 28 mm beside the arteries of a solved row are 0.2 to 1.4 times what `shape` says."""
MOST_SIGMAS, LEAST_TAIL = 30.0, 0.1
"""Deviations: from nothing beyond which odds would overflow, and a tail that changes nothing."""
MIN_SHARE = 0.3
"""Stations that feel less than this share of a pulse are not asked about it."""

NO_LEVEL = Judged(
    "undecided", float("nan"),
    "the force there or beside it is not above zero, so that nothing can be compared with it: take "
    "the zero in the air and scan again", 0.5,
)  # fmt: skip


@dataclass(frozen=True)
class Line:
    """The presses of one row that can be judged, along x; repeats at one place are averaged.

    ``depth_m`` is the median press's, 0 where depths were not recorded.
    """

    x_m: Array
    level_pa: Array
    level_sd_pa: Array
    pulse_pa: Array
    pulse_sd_pa: Array
    searches: tuple[tuple[Search, ...], ...]
    depth_m: float

    def levels(self, base: Array) -> Map:
        """The map of its levels over the columns ``base`` (n, k)."""
        return row_of(self.x_m, self.level_pa, self.level_sd_pa, base)


@dataclass(frozen=True)
class Place:
    """Where something is: from the level map, the pulse map, or both."""

    x_m: float
    sd_m: float
    low_m: float
    high_m: float
    level: Bump | None
    pulse: Bump | None


def line_of(presses: tuple[Press, ...]) -> Line:
    """A row's maps in order of x; repeats as `places_of` says."""
    judged = [
        (p.station.x_m, p, p.pulse)
        for p in presses
        if p.pulse is not None and np.isfinite(p.station.x_m)
    ]
    judged.sort(key=lambda one: one[0])
    group = places_of(np.array([x_m for x_m, *_ in judged]))
    repeats = [
        [one for one, g in zip(judged, group, strict=True) if g == k] for k in np.unique(group)
    ]
    rows = []
    for some in repeats:
        level = _mean([p.level_pa for _, p, _ in some], [p.level_sd_pa for _, p, _ in some])
        pulse = _mean([q.size_pa for *_, q in some], [q.size_sd_pa for *_, q in some])
        rows.append((float(np.mean([x_m for x_m, *_ in some])), *level, *pulse))
    searches = tuple(tuple(q.search for *_, q in some if q.search) for some in repeats)
    x_m, level_pa, level_sd, pulse_pa, pulse_sd = np.array(rows).reshape(-1, 5).T
    depths_m = [p.station.hold_depth_m for _, p, _ in judged]
    pressed_m = float(np.nan_to_num(np.median(depths_m))) if judged else 0.0
    return Line(x_m, level_pa, level_sd, pulse_pa, pulse_sd, searches, pressed_m)


def _mean(value: list[float], sd: list[float]) -> tuple[float, float]:
    """Mean weighted by variance, and its standard deviation."""
    if len(value) == 1:
        return value[0], sd[0]
    weight = 1 / np.maximum(sd, 1e-12) ** 2
    return float(weight @ value / weight.sum()), float(weight.sum() ** -0.5)


def objects_in(
    line: Line, pulse: float | None, false_alarm: float,
    under: Callable[[Array], Array] = surroundings,
) -> list[ObjectFinding]:  # fmt: skip
    """The objects under a row. ``pulse`` is the posterior probability that what moves in it is a
    pulse, None where nothing moves; ``under`` gives the columns of what may lie under the bumps of
    its level, `surroundings` or `with_edges`.

    Each of the two maps gets half of ``false_alarm``.
    """
    if len(line.x_m) < MIN_STATIONS:
        return []
    seen = line.levels(under(line.x_m))
    bumps = find_bumps(seen, false_alarm / 2)
    beats = _beats(line, false_alarm / 2) if pulse is not None else ()
    places = _together(bumps, beats, pitch_m(line.x_m))
    return [_object(place, line, pulse, beats, seen, bumps) for place in places]


def _beats(line: Line, false_alarm: float) -> tuple[Bump, ...]:
    """Where a row that pulses does: the clear bumps of its pulse map, or else the likeliest."""
    x_m, pulse_pa = line.x_m, line.pulse_pa
    # a hold shorter than a beat may say too little doubt: none counts more than the usual one
    own_pa = np.maximum(line.pulse_sd_pa, np.median(line.pulse_sd_pa))
    sd_pa = np.hypot(own_pa, BEAT_SCATTER * pulse_pa.max())
    seen = row_of(x_m, pulse_pa, sd_pa, floor(x_m))
    for chance, most in ((false_alarm, MAX_OBJECTS), (1.0, 1)):
        found = find_bumps(seen, chance, most, rising=True)
        if rising := tuple(bump for bump in found if bump.height > 0):
            return rising
    return (largest(seen),)


def largest(seen: Map) -> Bump:
    """Where a map without a clear bump is highest: as wide, and as sure a place, as its presses are
    apart."""
    k, reach_m = int(np.argmax(seen.value)), np.full(seen.axes, seen.spacing_m)
    return Bump(seen.place_m[k], reach_m, float(seen.value[k]), float(seen.sd[k]), seen.spacing_m,
                0.0, 1.0)  # fmt: skip


def _together(levels: tuple[Bump, ...], beats: tuple[Bump, ...], pitch: float) -> list[Place]:
    """A bump of either map with the other's nearest, if that is near enough to be the same."""
    places, left = [], list(beats)
    for level in levels:
        near = min(left, key=lambda b: abs(b.x_m - level.x_m), default=None)
        if near is not None and abs(near.x_m - level.x_m) < MIN_DISTANCE * pitch:
            left.remove(near)
            places.append(_joined(level, near))
        else:
            places.append(_alone(level, level, None))
    return places + [_alone(beat, None, beat) for beat in left]


def _alone(bump: Bump, level: Bump | None, pulse: Bump | None) -> Place:
    reach_m = float(bump.reach_m[0])
    return Place(
        bump.x_m, reach_m / NORMAL_95, bump.x_m - reach_m, bump.x_m + reach_m, level, pulse
    )


def _joined(level: Bump, pulse: Bump) -> Place:
    """Mean weighted by variance; where the two disagree, the interval grows (Birge 1932)."""
    one, other = _alone(level, level, None), _alone(pulse, None, pulse)
    weight = np.array([one.sd_m**-2, other.sd_m**-2])
    x_m = float(weight @ [one.x_m, other.x_m] / weight.sum())
    squared = float(weight @ (np.array([one.x_m, other.x_m]) - x_m) ** 2)
    sd = float(weight.sum() ** -0.5 * np.sqrt(max(1.0, squared)))
    reach = NORMAL_95 * sd
    return Place(x_m, sd, x_m - reach, x_m + reach, level, pulse)


def _object(
    place: Place, line: Line, moving: float | None, beats: tuple[Bump, ...], levels: Map,
    bumps: tuple[Bump, ...],
) -> ObjectFinding:  # fmt: skip
    at = int(np.argmin(np.abs(line.x_m - place.x_m)))
    bump = place.level
    if bump is None and place.pulse is not None:
        bump = at_places(levels, (*bumps, place.pulse))[-1]
    assert bump is not None
    ground, whole = bump.background, float(line.level_pa[at])
    if min(ground, whole) <= 0:
        return _finding(place, bump.height, float(line.pulse_pa[at]), NO_LEVEL, line)
    # the top is measured: what is added to the bump is taken from the ground
    height, height_sd = bump.height, bump.height_sd * max(1 + bump.height / ground, 1.0)
    pulse, pulse_sd = float(line.pulse_pa[at]), float(line.pulse_sd_pa[at])
    chance = min((b.p_value for b in (place.level, place.pulse) if b is not None), default=1.0)
    if place.pulse is not None:
        seen = Seen(
            pulse / whole, pulse_sd / whole, height / ground, height_sd / ground, chance=chance,
            moving=1.0 if moving is None else moving,
        )  # fmt: skip
    else:
        if moving is None:
            unseen = _unseen(line, place, whole * SIZES)
        else:  # another's pulse reaches here too
            tail_pa = float(_tail_pa(line.x_m[at], beats))
            sd_pa = pulse_sd * _stray(line, beats)
            unseen = measured(pulse, sd_pa, whole * SIZES, tail_pa)
            pulse = max(pulse - tail_pa, 0.0)
        seen = Seen(
            0.0, 0.0, height / ground, height_sd / ground, chance=chance, moving=0.0,
            hidden=unseen, alone=bump.alone, uneven=bump.uneven,
        )  # fmt: skip
    said = judge(seen)
    if said.kind != "undecided" and at in (0, len(line.x_m) - 1):
        said = replace(said, kind="undecided", reason=AT_AN_END)
    found = _finding(place, height, pulse, said, line)
    return replace(
        found, chances=said.chances, p_stiff=said.stiff, contrast=(seen.contrast, seen.contrast_sd),
        pulse_share=(pulse / whole, pulse_sd / whole),
    )  # fmt: skip


def _unseen(line: Line, place: Place, size_pa: Array) -> Array:
    """Likelihood (n,) of pulses of ``size_pa`` (n,) at a place, by all stations that would feel
    one."""
    bump = place.level
    width = bump.half_width_m if bump else pitch_m(line.x_m)
    near = [
        (float(share), one)
        for share, there in zip(shape(line.x_m, place.x_m, width), line.searches, strict=True)
        for one in there
        if share >= MIN_SHARE
    ]
    if not near:
        at = int(np.argmin(np.abs(line.x_m - place.x_m)))
        return measured(float(line.pulse_pa[at]), float(line.pulse_sd_pa[at]), size_pa)
    return hidden([one for _, one in near], np.array([s for s, _ in near]), size_pa)


def _tail_pa(x_m: Array, beats: tuple[Bump, ...]) -> Array:
    """What pulses at other places may make at ``x_m`` at most: far away `shape` knows it badly."""
    reach = [b.height * shape(x_m, b.x_m, b.half_width_m) for b in beats]
    return np.asarray(TAIL * np.sum(reach, axis=0))


def _stray(line: Line, beats: tuple[Bump, ...]) -> float:
    """`stray` of a row."""
    near = [shape(line.x_m, b.x_m, b.half_width_m) for b in beats]
    far = np.max(near, axis=0) < MIN_SHARE
    over_pa = line.pulse_pa - _tail_pa(line.x_m, beats)
    return stray(over_pa[far], line.pulse_sd_pa[far])


def stray(over_pa: Array, sd_pa: Array) -> float:
    """By how many of their stated deviations (n,), at least 1, two thirds of the pulses far from
    all vessels exceed what these make there, ``over_pa`` (n,): tremor, or a wrong rate, is in all
    presses of a map."""
    if not len(over_pa):
        return 1.0
    return max(float(np.quantile(over_pa / np.maximum(sd_pa, 1e-9), ONE_SIGMA)), 1.0)


def measured(size_pa: float, sd_pa: float, true_pa: Array, tail_pa: float = 0.0) -> Array:
    """Likelihood (n,) of pulses of ``true_pa`` (n,) beside that of none, where one was measured.

    Of the measured ``size_pa`` anything up to ``tail_pa`` is another's, each part alike.
    """
    sd = max(sd_pa, abs(size_pa) / MOST_SIGMAS, 1e-9)
    size, most = max(size_pa / sd, -NORMAL_95), max(tail_pa / sd, LEAST_TAIL)

    def of(own_pa: Array) -> Array:
        own = own_pa / sd - size
        return np.asarray(ndtr(own + most) - ndtr(own))

    return of(true_pa) / of(np.array(0.0))


def _finding(place: Place, height: float, pulse: float, said: Judged, line: Line) -> ObjectFinding:
    """The interval also holds where it lay before it was squeezed aside. It ends with the row, or
    for an object at an end of it a half width beyond."""
    aside = reach_inwards_m(place.x_m, line.x_m, line.depth_m)
    ends = place.low_m + min(aside, 0.0), place.high_m + max(aside, 0.0)
    low, high = (float(np.clip(x, line.x_m[0], line.x_m[-1])) for x in ends)
    at, bump = int(np.argmin(np.abs(line.x_m - place.x_m))), place.pulse or place.level
    half_width_m = bump.half_width_m if bump else 0.0
    low = low - half_width_m if at == 0 else low
    high = high + half_width_m if at == len(line.x_m) - 1 else high
    return ObjectFinding(
        said.kind, place.x_m, (low, high), height, pulse, said.confidence, said.reason,
        diseased=said.diseased,
    )  # fmt: skip
