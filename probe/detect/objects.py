"""What lies under one row of stations: the bumps of its level and pulse maps, put together."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from probe.detect.bumps import APART, FEWEST, Bump, Row, at_places, find_bumps
from probe.detect.finding import ObjectFinding
from probe.detect.kind import Judged, Seen, judge
from probe.detect.presses import Press

Array = NDArray[np.float64]

NORMAL_95 = 1.96


@dataclass(frozen=True)
class Line:
    """The presses of one row that can be judged, along x; repeats at one place are averaged."""

    x_m: Array
    level_pa: Array
    level_sd_pa: Array
    pulse_pa: Array
    pulse_sd_pa: Array
    chance: Array
    tries: Array


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
    """A row's maps in order of x."""
    judged = [p for p in presses if p.pulse is not None and np.isfinite(p.station.x_m)]
    judged.sort(key=lambda p: p.station.x_m)
    columns = [
        (
            p.station.x_m,
            p.level_pa,
            p.level_sd_pa,
            p.pulse.size_pa,
            p.pulse.size_sd_pa,
            p.pulse.p_value,
            p.pulse.tries,
        )
        for p in judged
        if p.pulse is not None
    ]
    table = np.array(columns).reshape(-1, 7)
    return Line(*(table if len(table) < 2 else _merged(table)).T)


def _merged(table: Array) -> Array:
    """Stations closer than a tenth of the row's pitch are repeats of one place."""
    gaps = np.diff(table[:, 0])
    pitch = float(np.median(gaps[gaps > 1e-6])) if (gaps > 1e-6).any() else 0.0
    group = np.concatenate([[0], np.cumsum(gaps > 0.1 * pitch)])
    return np.array([_mean_of(table[group == g]) for g in range(group[-1] + 1)])


def _mean_of(rows: Array) -> Array:
    if len(rows) == 1:
        return np.asarray(rows[0])
    mean = [rows[:, 0].mean()]
    for value, sd in ((rows[:, 1], rows[:, 2]), (rows[:, 3], rows[:, 4])):
        weight = 1 / np.maximum(sd, 1e-12) ** 2
        mean += [float(weight @ value / weight.sum()), float(weight.sum() ** -0.5)]
    return np.array([*mean, min(1.0, rows[:, 5].min() * len(rows)), rows[:, 6].max()])


def objects_in(line: Line, pulsing: bool, false_alarm: float) -> list[ObjectFinding]:
    """The objects under a row. ``pulsing``: a station of it has a pulse.

    Each of the two maps gets half of ``false_alarm``.
    """
    if len(line.x_m) < FEWEST:
        return []
    levels = find_bumps(line.x_m, line.level_pa, line.level_sd_pa, false_alarm / 2)
    beats = Row((), np.zeros(len(line.x_m)), 1.0)
    if pulsing:
        # presses count alike: what a hold shorter than a beat says of its own doubt is doubtful
        even = np.full(len(line.x_m), np.median(line.pulse_sd_pa))
        found = find_bumps(line.x_m, line.pulse_pa, even, false_alarm / 2)
        beats = replace(found, bumps=tuple(b for b in found.bumps if b.height > 0))
    places = _together(levels.bumps, beats.bumps, float(np.median(np.diff(line.x_m))))
    if pulsing and not any(place.pulse for place in places):
        places = _with_strongest(places, line)
    return [_object(place, line, pulsing) for place in places]


def _together(levels: tuple[Bump, ...], beats: tuple[Bump, ...], pitch: float) -> list[Place]:
    """A bump of either map with the other's nearest, if that is near enough to be the same."""
    places, left = [], list(beats)
    for level in levels:
        near = min(left, key=lambda b: abs(b.x_m - level.x_m), default=None)
        if near is not None and abs(near.x_m - level.x_m) < APART * pitch:
            left.remove(near)
            places.append(_joined(level, near))
        else:
            places.append(_alone(level, level, None))
    return places + [_alone(beat, None, beat) for beat in left]


def _alone(bump: Bump, level: Bump | None, pulse: Bump | None) -> Place:
    sd = (bump.x_high_m - bump.x_low_m) / (2 * NORMAL_95)
    return Place(bump.x_m, sd, bump.x_low_m, bump.x_high_m, level, pulse)


def _joined(level: Bump, pulse: Bump) -> Place:
    """Mean weighted by variance; where the two disagree, the interval grows (Birge 1932)."""
    one, other = _alone(level, level, None), _alone(pulse, None, pulse)
    weight = np.array([one.sd_m**-2, other.sd_m**-2])
    x_m = float(weight @ [one.x_m, other.x_m] / weight.sum())
    apart = float(weight @ (np.array([one.x_m, other.x_m]) - x_m) ** 2)
    sd = float(weight.sum() ** -0.5 * np.sqrt(max(1.0, apart)))
    reach = NORMAL_95 * sd
    return Place(x_m, sd, x_m - reach, x_m + reach, level, pulse)


def _with_strongest(places: list[Place], line: Line) -> list[Place]:
    """A pulse without a bump of its own is at the strongest station, within a pitch."""
    pitch = float(np.median(np.diff(line.x_m)))
    x_m = float(line.x_m[int(np.argmax(line.pulse_pa))])
    height = float(line.pulse_pa.max())
    beat = Bump(x_m, x_m - pitch, x_m + pitch, height, float(line.pulse_sd_pa.max()), pitch, 0.0)
    near = [p for p in places if p.low_m - pitch <= x_m <= p.high_m + pitch]
    if near:
        closest = min(near, key=lambda p: abs(p.x_m - x_m))
        return [replace(p, pulse=beat) if p is closest else p for p in places]
    return [*places, _alone(beat, None, beat)]


def _object(place: Place, line: Line, pulsing: bool) -> ObjectFinding:
    at = int(np.argmin(np.abs(line.x_m - place.x_m)))
    bump = place.level or place.pulse
    level = at_places(line.x_m, line.level_pa, line.level_sd_pa, (bump,) if bump else ())
    height, height_sd = level.bumps[0].height, level.bumps[0].height_sd
    ground = max(float(level.background[at]), 1e-9)
    pulse, pulse_sd = float(line.pulse_pa[at]), float(line.pulse_sd_pa[at])
    chance = float(line.chance[at])
    if place.pulse is None and pulsing:
        # a neighbour's pulse is felt here too: only what rises above it is this object's
        pulse, pulse_sd, chance = 0.0, max(pulse_sd, 0.1 * pulse), 0.5
    whole = max(float(line.level_pa[at]), 1e-9)
    seen = Seen(height / ground, height_sd / ground, pulse / whole, pulse_sd / whole,
                place.pulse is not None, chance, float(line.tries[at]))  # fmt: skip
    said = judge(seen)
    return _finding(place, height, pulse, said)


def _finding(place: Place, height: float, pulse: float, said: Judged) -> ObjectFinding:
    return ObjectFinding(
        said.kind, place.x_m, (place.low_m, place.high_m), height, pulse, said.confidence,
        said.reason,
    )  # fmt: skip
