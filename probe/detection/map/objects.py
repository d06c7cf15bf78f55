"""What lies under a map of presses: the bumps of its level and its pulse, put together."""

from dataclasses import dataclass, replace

import numpy as np

from drivers.core.arrays import Array
from probe.core.finding_words import AT_AN_END, NORMAL_95
from probe.detection.classify.kinds import Judged, Seen, judge
from probe.detection.finding import UNDECIDED, ObjectFinding
from probe.detection.map.area import among
from probe.detection.map.bumps import (
    MAX_OBJECTS,
    MIN_DISTANCE,
    MIN_STATIONS,
    Bump,
    at_places,
    find_bumps,
)
from probe.detection.map.pressed import Pressed
from probe.detection.map.ridge import Ridge, find_ridge, on_ridge, with_course
from probe.detection.map.seen_map import Map
from probe.detection.map.sideways import reach_inwards_m
from probe.detection.map.unseen_pulse import unseen, unseen_beside

NO_LEVEL = Judged(
    UNDECIDED, float("nan"),
    "the force there or beside it is not above zero, so that nothing can be compared with it: take "
    "the zero in the air and scan again", 0.5,
)  # fmt: skip


@dataclass(frozen=True)
class Place:
    """Where something is, ``at_m`` (d,) with the half width of its 95 % interval ``reach_m`` (d,):
    from the level map, the pulse map, or both."""

    at_m: Array
    reach_m: Array
    level: Bump | None
    pulse: Bump | None


def objects_in(
    pressed: Pressed, moving: float | None, false_alarm: float, base: Array | None = None
) -> list[ObjectFinding]:
    """The objects under a row or an area.

    ``moving`` is the posterior probability that what moves in it is a pulse, None where nothing
    moves; ``base`` as of `Pressed.levels`. Each of the two maps gets half of ``false_alarm``.
    """
    if len(pressed.level_pa) < MIN_STATIONS:
        return []
    levels = pressed.levels(base)
    bumps = find_bumps(levels, false_alarm / 2)
    beats = beating(pressed, false_alarm / 2) if moving is not None else ()
    seen = _Seen(pressed, levels, bumps, beats, moving)
    aside, alone, objects = bumps, beats, []
    if not pressed.is_row and (ridge := find_ridge(pressed.pulses(), beats)) is not None:
        objects.append(_vessel(ridge, seen))
        on_it = MIN_DISTANCE * levels.spacing_m
        aside = tuple(bump for bump in bumps if ridge.away_m(bump.place_m) >= on_it)
        alone = tuple(beat for beat in beats if ridge.away_m(beat.place_m) >= on_it)
    return [*objects, *(_object(p, seen) for p in _together(aside, alone, levels.spacing_m))]


def beating(pressed: Pressed, false_alarm: float) -> tuple[Bump, ...]:
    """Where a map that pulses does: the clear bumps of its pulse map, or else the likeliest."""
    seen = pressed.pulses()
    for chance, most in ((false_alarm, MAX_OBJECTS), (1.0, 1)):
        bumps = find_bumps(seen, chance, most, rising=True)
        if rising := tuple(bump for bump in bumps if bump.height > 0):
            return rising
    return (largest(seen),)


def largest(seen: Map) -> Bump:
    """Where a map without a clear bump is highest: as wide, and as sure a place, as its presses are
    apart."""
    k, reach_m = int(np.argmax(seen.value)), np.full(seen.axes, seen.spacing_m)
    return Bump(seen.place_m[k], reach_m, float(seen.value[k]), float(seen.sd[k]), seen.spacing_m,
                0.0, 1.0)  # fmt: skip


@dataclass(frozen=True)
class _Seen:
    """A map with its bumps of level and pulse, and how surely what moves is a pulse."""

    pressed: Pressed
    levels: Map
    bumps: tuple[Bump, ...]
    beats: tuple[Bump, ...]
    moving: float | None

    def nearest(self, at_m: Array) -> int:
        return int(np.argmin(((self.levels.place_m - at_m) ** 2).sum(axis=1)))


def _together(levels: tuple[Bump, ...], beats: tuple[Bump, ...], spacing_m: float) -> list[Place]:
    """A bump of either map with the other's nearest, if that is near enough to be the same."""

    def away_m(bump: Bump, other: Bump) -> float:
        return float(np.linalg.norm(bump.place_m - other.place_m))

    places, alone = [], list(beats)
    for level in levels:
        near = min(alone, key=lambda beat: away_m(beat, level), default=None)
        if near is None or away_m(near, level) >= MIN_DISTANCE * spacing_m:
            places.append(Place(level.place_m, level.reach_m, level, None))
        else:
            alone = [beat for beat in alone if beat is not near]
            places.append(_joined(level, near))
    return places + [Place(beat.place_m, beat.reach_m, None, beat) for beat in alone]


def _joined(level: Bump, pulse: Bump) -> Place:
    """Mean weighted by variance; where the two disagree, the interval grows (Birge 1932)."""
    both_m = np.array([level.place_m, pulse.place_m])
    weight = NORMAL_95**2 / np.array([level.reach_m, pulse.reach_m]) ** 2
    at_m = (weight * both_m).sum(axis=0) / weight.sum(axis=0)
    squared = (weight * (both_m - at_m) ** 2).sum(axis=0)
    sd_m = np.sqrt(np.maximum(1.0, squared) / weight.sum(axis=0))
    return Place(at_m, NORMAL_95 * sd_m, level, pulse)


def _vessel(ridge: Ridge, seen: _Seen) -> ObjectFinding:
    """The vessel along ``ridge``, judged where it is pressed nearest to its middle."""
    levels, course = seen.levels, ridge.course_m
    away = np.hypot(*(levels.place_m - course[len(course) // 2]).T)
    at = int(np.argmin(away + levels.spacing_m * (1 - ridge.shape(levels.place_m))))
    # on the line, beside the press
    angle, place_m = ridge.angle_rad, levels.place_m[at]
    normal = np.array([-np.sin(angle), np.cos(angle)])
    place_m = place_m + (ridge.at_m - float(normal @ place_m)) * normal
    level = on_ridge(levels, ridge, place_m)
    judged = _judged(Place(place_m, level.reach_m, level, level), seen)
    return with_course(judged, ridge)


def _object(place: Place, seen: _Seen) -> ObjectFinding:
    """What lies at a place; at an end of what was pressed it is not named, and may lie as far
    beyond as its half width."""
    thing = _judged(place, seen)
    if not _at_an_end(place.at_m, seen):
        return thing
    bump = place.pulse or place.level
    assert bump is not None
    low, high = thing.position_ci_m
    below = place.at_m[0] < (seen.pressed.x_m.min() + seen.pressed.x_m.max()) / 2
    beyond_m = (low - bump.half_width_m, high) if below else (low, high + bump.half_width_m)
    thing = replace(thing, position_ci_m=beyond_m)
    return thing.undecided(AT_AN_END) if thing.is_named else thing


def _at_an_end(at_m: Array, seen: _Seen) -> bool:
    """Whether nothing was pressed beyond a place (d,), to some side."""
    levels = seen.levels
    if levels.is_row:
        return seen.nearest(at_m) in (0, len(levels.value) - 1)
    beyond_m = 0.5 * levels.spacing_m * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    return not among(at_m + beyond_m, levels.place_m).all()


def _judged(place: Place, seen: _Seen) -> ObjectFinding:
    """What lies at a place, by what its nearest press measured."""
    pressed, at = seen.pressed, seen.nearest(place.at_m)
    bump = place.level
    if bump is None and place.pulse is not None:
        bump = at_places(seen.levels, (*seen.bumps, place.pulse))[-1]
    assert bump is not None
    ground, whole = bump.background, float(pressed.level_pa[at])
    pulse, pulse_sd = float(pressed.pulse_pa[at]), float(pressed.pulse_sd_pa[at])
    if min(ground, whole) <= 0:
        return _finding(place, bump.height, pulse, NO_LEVEL, pressed)
    # the top is measured: what is added to the bump is taken from the ground
    contrast = bump.height / ground
    contrast_sd = bump.height_sd / ground * max(1 + contrast, 1.0)
    chance = min((b.p_value for b in (place.level, place.pulse) if b is not None), default=1.0)
    if place.pulse is not None:
        said = judge(Seen(
            pulse / whole, pulse_sd / whole, contrast, contrast_sd, chance=chance,
            moving=1.0 if seen.moving is None else seen.moving,
        ))  # fmt: skip
    else:
        if seen.moving is None:
            still = unseen(pressed, bump)
        else:
            still, pulse = unseen_beside(pressed, at, seen.beats)
        said = judge(Seen(
            0.0, 0.0, contrast, contrast_sd, chance=chance, moving=0.0, hidden=still,
            alone=bump.alone, uneven=bump.uneven,
        ))  # fmt: skip
    return replace(
        _finding(place, bump.height, pulse, said, pressed), chances=said.chances,
        p_stiff=said.stiff, contrast=(contrast, contrast_sd),
        pulse_share=(pulse / whole, pulse_sd / whole),
    )  # fmt: skip


def _finding(
    place: Place, height_pa: float, pulse_pa: float, said: Judged, pressed: Pressed
) -> ObjectFinding:
    """The interval also holds where it lay before it was squeezed aside, and ends with what was
    pressed."""
    x_m, reach_m = float(place.at_m[0]), float(place.reach_m[0])
    low_m, high_m = x_m - reach_m, x_m + reach_m
    if pressed.is_row:
        aside_m = reach_inwards_m(x_m, pressed.x_m, pressed.depth_m)
        low_m, high_m = low_m + min(aside_m, 0.0), high_m + max(aside_m, 0.0)
    ends_m = pressed.x_m.min(), pressed.x_m.max()
    low_m, high_m = (float(np.clip(end, *ends_m)) for end in (low_m, high_m))
    course = () if pressed.is_row else ((x_m, float(place.at_m[1])),)
    return ObjectFinding(
        said.kind, x_m, (low_m, high_m), height_pa, pulse_pa, said.confidence, said.reason,
        course, diseased=said.diseased,
    )  # fmt: skip
