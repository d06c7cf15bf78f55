"""What is stiff along a straight line: a bone, a tendon or a band, or a lump that is long."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit

from drivers.core.arrays import Array
from probe.core.finding_words import percent
from probe.detection.classify.kinds import ELSE, MIN_POSTERIOR, PRIOR
from probe.detection.finding import LUMP, UNDECIDED, ObjectFinding, stated
from probe.detection.map.bump_fit import tried_m
from probe.detection.map.bumps import MIN_DISTANCE, TRUSTED, chance
from probe.detection.map.pressed import Pressed
from probe.detection.map.rivals import TURNS_RAD, directions, rises_anywhere
from probe.detection.map.row_doubts import LUMP_SHARE
from probe.detection.map.row_shapes import level_of, shape, step
from probe.detection.map.seen_map import Map, bump_at, explained, weighted

MIN_POINTS = 3
"""Of a course: two are always on a line."""
ELSE_OF_A_LINE = PRIOR[ELSE] / (PRIOR[ELSE] + PRIOR[LUMP])
"""Of what is as stiff from one edge of a map to the other, and does not pulse."""
WIDE = 4
"""Directions that differ by less than a ridge's width shows: a twelfth of half a turn each."""
SWEEPS = 2
"""Through all lumps of a grid, each fitted beside what the others were fitted as."""


def unnamed_line(pressed: Pressed, false_alarm: float) -> list[ObjectFinding]:
    """What is as high as a lump in a map without bumps, but straight, undecided."""
    levels = pressed.levels()
    p_value, height_pa = _straight_rise(levels) if levels.spacing_m > 0 else (1.0, 0.0)
    if p_value > false_alarm or abs(height_pa) < LUMP_SHARE * level_of(levels.value):
        return []
    x_m, word = levels.place_m[:, 0], "stiffer" if height_pa > 0 else "softer"
    return [ObjectFinding(
        UNDECIDED, float(np.median(x_m)), (float(x_m.min()), float(x_m.max())), height_pa,
        float(np.median(pressed.pulse_pa)), 0.0,
        f"no pulse; {abs(height_pa):.0f} Pa {word} along a straight line or on one side of it, as "
        "over a bone, a tendon or a step of the surface: press as deep from where the surface is "
        "at each station, and farther to all sides",
    )]  # fmt: skip


def _straight_rise(seen: Map) -> tuple[float, float]:
    """The chance of a step or ridge as clear as the clearest anywhere in a map that has none, and
    its height, negative where it is a furrow."""
    _, a, _, residual = weighted(seen, [])
    before, most, rise_pa = float(residual @ residual), 0.0, 0.0
    for along_m in directions(seen).T:
        for form in (shape, step):
            columns = rises_anywhere(along_m, seen.spacing_m, form)[:, :, 0].T
            drop, height = explained(a, residual, columns / seen.sd[:, None])
            if drop.max() > most:
                k = int(np.argmax(drop))
                most, rise_pa = float(drop[k]), float(height[k] * np.ptp(columns[:, k]))
    lines = len(TURNS_RAD) / WIDE * seen.span_m / seen.spacing_m
    dof = len(seen.value) - seen.base.shape[1]
    return chance(before, before - most, seen.unknowns, dof, 2 * lines), rise_pa


def or_lines(
    named: list[ObjectFinding], levels: Map, rows_m: Sequence[float]
) -> list[ObjectFinding]:
    """The lumps of a grid of rows at ``rows_m`` in which nothing pulses; where a straight line from
    its first row to its last explains ``levels`` better than a ball, what that may be, undecided.
    """
    groups = _straight(named, levels.spacing_m, rows_m)
    if levels.spacing_m <= 0 or not groups:
        return named
    rest = [lump for lump in named if not any(lump in group for group in groups)]
    balls = [_balls(levels, group) for group in groups]
    lines = [_lines(levels, group) for group in groups]
    others = [_balls(levels, [lump]) for lump in rest]
    as_lines = _left(levels, [*lines, *others])
    dof = max(len(levels.value) - levels.base.shape[1] - levels.unknowns * len(named), 1)
    scatter = max((as_lines + TRUSTED) / (dof + TRUSTED), 1.0)
    judged = rest
    for k, group in enumerate(groups):
        as_ball = _left(levels, [*lines[:k], balls[k], *lines[k + 1 :], *others])
        line = float(expit((as_ball - as_lines) / (2 * scatter)))
        judged = [*judged, *_or_line(group, line)]
    return judged


def _straight(
    named: list[ObjectFinding], station_m: float, rows_m: Sequence[float]
) -> list[list[ObjectFinding]]:
    """Lumps whose course is straight from the first row to the last, each by itself; of what is
    left all, if together it is so."""

    def is_line(lumps: list[ObjectFinding]) -> bool:
        points_m = _points(lumps)
        if len(points_m) < MIN_POINTS or not any(lump.is_named for lump in lumps):
            return False
        off_m = points_m - points_m.mean(axis=0)
        aside_m = off_m @ np.linalg.svd(off_m, full_matrices=False)[2][1]
        reaches = points_m[0, 1] <= min(rows_m) and points_m[-1, 1] >= max(rows_m)
        return bool(reaches and np.abs(aside_m).max() <= MIN_DISTANCE * station_m)

    groups = [[lump] for lump in named if is_line([lump])]
    others = [lump for lump in named if [lump] not in groups]
    return [*groups, others] if is_line(others) else groups


def _points(lumps: list[ObjectFinding]) -> Array:
    """Where rows show them, (k, 2), in order of y."""
    points_m = np.array([place for lump in lumps for place in lump.course]).reshape(-1, 2)
    return np.asarray(points_m[np.argsort(points_m[:, 1])])


def _balls(levels: Map, lumps: list[ObjectFinding]) -> Array:
    """What a ball at any place of a course makes of each press, (n, places and widths)."""
    widths_m = tried_m(levels.spacing_m, levels.span_m)
    points_m = _points(lumps) if lumps[0].course else levels.place_m
    return np.column_stack([
        bump_at(levels.place_m, np.append(place_m, w)) for place_m in points_m for w in widths_m
    ])  # fmt: skip


def _lines(levels: Map, lumps: list[ObjectFinding]) -> Array:
    """What the straight line along a course makes of each press, (n, widths)."""
    points_m = _points(lumps)
    middle_m = points_m.mean(axis=0)
    across = np.linalg.svd(points_m - middle_m, full_matrices=False)[2][1]
    aside_m = (levels.place_m - middle_m) @ across
    widths_m = tried_m(levels.spacing_m, levels.span_m)
    return shape(aside_m[:, None], 0.0, widths_m)


def _left(levels: Map, sets: list[Array]) -> float:
    """What the best column (n,) of each of ``sets`` leaves of the map, weighted and squared."""
    _, a, b, _ = weighted(levels, [])
    chosen: dict[int, Array] = {}
    for _ in range(SWEEPS):
        for k, columns in enumerate(sets):
            columns_so_far = np.column_stack([a, *(c for j, c in chosen.items() if j != k)])
            drop, _ = explained(columns_so_far, b, columns / levels.sd[:, None])
            best = np.zeros(len(a))
            best[: len(columns)] = columns[:, int(np.argmax(drop))] / levels.sd
            chosen[k] = best
    q, _ = np.linalg.qr(np.column_stack([a, *chosen.values()]))
    residual = b - q @ (q.T @ b)
    return float(residual @ residual)


def _or_line(group: list[ObjectFinding], line: float) -> list[ObjectFinding]:
    """The lumps of ``group``, or one undecided object if they are a line with probability ``line``
    and none is sure enough then."""
    clearest = max(group, key=lambda lump: lump.confidence)
    confidence = clearest.confidence * (1 - ELSE_OF_A_LINE * line)
    if confidence >= MIN_POSTERIOR:
        return group
    points_m = _points(group)
    ends_m = [end for lump in group for end in lump.position_ci_m]
    return [replace(
        clearest, kind=UNDECIDED, confidence=stated(confidence),
        position_m=float(np.median(points_m[:, 0])), position_ci_m=(min(ends_m), max(ends_m)),
        course=tuple((float(x), float(y)) for x, y in points_m),
        reason=f"between tumour {percent(stated(confidence))} and a bone, a tendon or a band: as "
        "stiff along a straight line from edge to edge of the map; press farther along it, where a "
        "lump ends",
    )]  # fmt: skip
