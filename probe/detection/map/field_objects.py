"""What lies under presses at any places (x, y): the bumps of level and pulse, put together."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivers.core.arrays import Array
from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.core.finding_words import AT_AN_END
from probe.core.recording import Station
from probe.detection.classify.kinds import SIZES, Judged, Seen, judge
from probe.detection.finding import ObjectFinding
from probe.detection.map.area import MIN_PRESSES, among, map_of, spacing_m
from probe.detection.map.bumps import MIN_DISTANCE, MIN_STATIONS, Bump, at_places, find_bumps
from probe.detection.map.ridge import Ridge, find_ridge, on_ridge, with_course
from probe.detection.map.row_objects import (
    BEAT_SCATTER,
    MIN_SHARE,
    NO_LEVEL,
    TAIL,
    largest,
    measured,
    stray,
)
from probe.detection.map.seen_map import Map, bump_at
from probe.detection.map.straight_line import unnamed_line
from probe.detection.map.vessel_tracking import MAX_STRAY_PITCHES
from probe.detection.pulse.pooled_evidence import hidden
from probe.detection.pulse.presses import Press
from probe.detection.repeats import distinct_m

MIN_ROWS = 3
"""Rows that show which way a line goes: through a bump in each of two there is always one."""
MOST_ASKED = 8
"""Presses nearest to a bump that are asked for a hidden pulse: farther ones hardly feel it."""


def is_field(stations: Sequence[Station], rows: list[list[int]]) -> bool:
    """Whether the stations in ``rows`` are a map without rows: most lie in none that could show a
    bump, and together they cover an area."""
    every = [
        i for row in rows for i in row if np.isfinite([stations[i].x_m, stations[i].y_m]).all()
    ]
    in_rows = sum(
        len(row) for row in rows
        if len(distinct_m(np.array([stations[i].x_m for i in row]))) >= MIN_STATIONS
    )  # fmt: skip
    return 2 * in_rows < len(every) and spacing_m(_places([stations[i] for i in every])) > 0


def runs_along_rows(presses: Sequence[Press], pitch_m: float) -> bool:
    """Whether a vessel runs so much along the rows of a grid that no row shows it as a bump, or it
    is too far aside in the next row: rows are then presses at any places. ``pitch_m`` is the rows'
    own."""
    judged = judged_of(presses)
    y_m = distinct_m(np.array([p.station.y_m for p in judged]))
    if len(judged) < MIN_PRESSES or len(y_m) < MIN_ROWS:
        return False
    ridge = find_ridge(pulses_of(judged), _beating(judged, DEFAULT_FALSE_ALARM))
    if ridge is None:
        return False
    aside_m = float(np.median(np.diff(y_m))) / max(abs(np.tan(ridge.angle_rad)), 1e-9)
    return bool(aside_m > MAX_STRAY_PITCHES * pitch_m)


def objects_in_field(
    presses: tuple[Press, ...], moving: float | None, false_alarm: float
) -> list[ObjectFinding]:
    """The objects under a map. ``moving`` is the posterior probability that what moves is a pulse,
    None where nothing does. Each of the two maps gets half of ``false_alarm``."""
    judged = judged_of(presses)
    levels = levels_of(judged)
    stiff = find_bumps(levels, false_alarm / 2)
    vessels = _beating(judged, false_alarm / 2) if moving is not None else ()
    beating, found = list(vessels), []
    if (ridge := find_ridge(pulses_of(judged), beating)) is not None:
        on_it = MIN_DISTANCE * levels.spacing_m
        stiff = tuple(one for one in stiff if ridge.away_m(one.place_m) >= on_it)
        beating = [one for one in beating if ridge.away_m(one.place_m) >= on_it]
        found.append(_vessel(ridge, judged, levels, moving))
    for bump in stiff:
        near = [one for one in beating if _apart(one, bump) < MIN_DISTANCE * levels.spacing_m]
        if near:
            nearest = min(near, key=lambda one: _apart(one, bump))
            beating = [one for one in beating if one is not nearest]
        still = None if near else _still(bump, judged, levels, vessels)
        found.append(_inside(_object(bump, bump, judged, levels, moving, still), bump, levels))
    for bump in beating:
        (level,) = at_places(levels, [bump])
        found.append(_inside(_object(bump, level, judged, levels, moving, None), bump, levels))
    return found or unnamed_line(judged, levels, false_alarm)


def levels_of(judged: list[Press]) -> Map:
    """The map of their levels."""
    level, sd = np.array([(p.level_pa, p.level_sd_pa) for p in judged]).reshape(-1, 2).T
    return map_of(_places([p.station for p in judged]), level, sd)


def pulses_of(judged: list[Press]) -> Map:
    """The map of their pulses, as uncertain as a heart's beats differ and as the usual press is."""
    pulse = np.array([p.size_pa for p in judged])
    noise = np.median([p.pulse.size_sd_pa for p in judged if p.pulse is not None])
    sd = np.full(len(pulse), float(np.hypot(noise, BEAT_SCATTER * pulse.max())))
    return map_of(_places([p.station for p in judged]), pulse, sd, curved=False)


def _vessel(ridge: Ridge, judged: list[Press], levels: Map, moving: float | None) -> ObjectFinding:
    """The vessel along ``ridge``, judged where it is pressed nearest to its middle."""
    course = ridge.course_m
    away = np.hypot(*(levels.place_m - course[len(course) // 2]).T)
    at = int(np.argmin(away + levels.spacing_m * (1 - ridge.shape(levels.place_m))))
    # on the line, beside the press
    angle, place = ridge.angle_rad, levels.place_m[at]
    normal = np.array([-np.sin(angle), np.cos(angle)])
    place = place + (ridge.at_m - float(normal @ place)) * normal
    level = on_ridge(levels, ridge, place)
    return with_course(_object(level, level, judged, levels, moving, None), ridge)


def _places(stations: list[Station]) -> Array:
    return np.array([(s.x_m, s.y_m) for s in stations]).reshape(-1, 2)


def _apart(one: Bump, other: Bump) -> float:
    return float(np.hypot(*(one.place_m - other.place_m)))


def judged_of(presses: Sequence[Press]) -> list[Press]:
    """Those with a known place that could be judged."""
    return [p for p in presses if p.pulse is not None
            and np.isfinite([p.station.x_m, p.station.y_m]).all()]  # fmt: skip


def _beating(judged: list[Press], false_alarm: float) -> tuple[Bump, ...]:
    """Where a map that pulses does: its clear bumps, or else the press that pulses most."""
    seen = pulses_of(judged)
    bumps = find_bumps(seen, false_alarm, rising=True)
    return tuple(one for one in bumps if one.height > 0) or (largest(seen),)


def _still(bump: Bump, judged: list[Press], levels: Map, vessels: tuple[Bump, ...]) -> Array:
    """Likelihood of a pulse of `SIZES` under a ``bump`` that shows none of its own: by all presses
    that would feel it, or beside ``vessels`` by the nearest, whose pulse may be all theirs."""
    away = np.argsort(np.hypot(*(levels.place_m - bump.place_m).T))
    wanted_pa = max(judged[int(away[0])].level_pa, 1e-9) * SIZES
    if vessels:
        near = [bump_at(levels.place_m, one.shape) for one in vessels]
        tail_pa = TAIL * np.sum([b.height * n for b, n in zip(vessels, near, strict=True)], axis=0)
        size_pa = np.array([p.size_pa for p in judged])
        sd_pa = np.array([p.pulse.size_sd_pa if p.pulse else np.inf for p in judged])
        far, at = np.max(near, axis=0) < MIN_SHARE, int(away[0])
        beyond = stray((size_pa - tail_pa)[far], sd_pa[far])
        return measured(
            float(size_pa[at]), float(sd_pa[at]) * beyond, wanted_pa, float(tail_pa[at])
        )
    share = bump_at(levels.place_m, bump.shape)
    close = [i for i in away[:MOST_ASKED] if share[i] >= MIN_SHARE] or [int(away[0])]
    asked = [(share[i], s) for i in close if (one := judged[i].pulse) and (s := one.search)]
    if not asked:
        return np.ones(len(SIZES))
    return hidden([s for _, s in asked], np.array([k for k, _ in asked]), wanted_pa)


def _object(
    bump: Bump, level: Bump, judged: list[Press], levels: Map, moving: float | None,
    still: Array | None,
) -> ObjectFinding:  # fmt: skip
    """An object at ``bump``; ``level`` is its bump in the level map, and ``still`` the likelihood
    of pulses of `SIZES` where it shows none of its own."""
    off = np.hypot(*(levels.place_m - bump.place_m).T)
    nearest = judged[int(np.argmin(off))]
    assert nearest.pulse is not None
    ground, whole = level.background, nearest.level_pa
    if min(ground, whole) <= 0:
        return _placed(bump, level, nearest.size_pa, NO_LEVEL, levels)
    contrast, contrast_sd = level.height / ground, level.height_sd / ground
    pulse, pulse_sd = nearest.size_pa, nearest.pulse.size_sd_pa
    if still is None:
        seen = Seen(
            pulse / whole, pulse_sd / whole, contrast, contrast_sd, chance=bump.p_value,
            moving=1.0 if moving is None else moving,
        )  # fmt: skip
    else:
        seen = Seen(
            0.0, 0.0, contrast, contrast_sd, chance=bump.p_value, moving=0.0, hidden=still,
            alone=bump.alone, uneven=bump.uneven,
        )  # fmt: skip
    said = judge(seen)
    return replace(
        _placed(bump, level, pulse, said, levels), diseased=said.diseased, p_stiff=said.stiff,
        chances=said.chances,
        contrast=(contrast, contrast_sd), pulse_share=(pulse / whole, pulse_sd / whole),
    )  # fmt: skip


def _placed(bump: Bump, level: Bump, pulse_pa: float, said: Judged, levels: Map) -> ObjectFinding:
    x, y = (float(v) for v in bump.place_m)
    low, high = levels.place_m.min(axis=0)[0], levels.place_m.max(axis=0)[0]
    reach = float(bump.reach_m[0])
    return ObjectFinding(
        said.kind, x, (float(max(x - reach, low)), float(min(x + reach, high))), level.height,
        pulse_pa, said.confidence, said.reason, ((x, y),),
    )  # fmt: skip


def _inside(one: ObjectFinding, bump: Bump, levels: Map) -> ObjectFinding:
    """A bump beyond which nothing was pressed on some side may lie there, as far as its half width,
    and is not named."""
    beyond_m = 0.5 * levels.spacing_m * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    if among(bump.place_m + beyond_m, levels.place_m).all():
        return one
    reach_m = float(bump.reach_m[0]) + bump.half_width_m
    one = replace(one, position_ci_m=(one.position_m - reach_m, one.position_m + reach_m))
    return one if one.kind == "undecided" else replace(one, kind="undecided", reason=AT_AN_END)
