"""What finished rows show that is no finding, and no reason to say "nothing" either: undecided."""

import numpy as np

from drivers.core.arrays import Array
from probe.core.finding_words import NORMAL_95
from probe.detection.finding import UNDECIDED, ObjectFinding
from probe.detection.map.bump_fit import tried_m
from probe.detection.map.bumps import MIN_STATIONS, evenness, find_bumps
from probe.detection.map.pressed import Pressed
from probe.detection.map.row_shapes import level_of, shape, surroundings, with_edges
from probe.detection.map.seen_map import weighted
from probe.detection.map.vessel_tracking import across_rows
from probe.detection.repeats import pitch_m

LUMP_SHARE = 0.11
"""What a lump adds to the level at its middle: the built-in scene TIT, 9094 over 8187 Pa."""
DOUBT = 0.05
"""Chance below which a bump that is no finding yet is no reason to say "nothing" either."""
MIN_ROWS, LEFT_WITHOUT = 3, 0.1
"""Rows that show more than a tilt, any of which may be the odd one where there are no more; and the
share of what a tilt leaves of the rows' levels, squared, that is left without the odd one. Of 4 to
10 rows that scatter by 1 % a single one 11 to 60 % off leaves less in 98 % and more, a surface that
is curved as much in 6 % of four rows and in none of more."""


def beside_named(line: Pressed, named: list[ObjectFinding], chance: float) -> list[ObjectFinding]:
    """``named``, the objects of a finished row, and what is stiffer far beside them, undecided,
    where it has a ``chance`` of being none: two bumps have as many unknowns as a short row has
    stations, and neither is clear. The level's shape at what was named is taken to be known.

    How much stiffer is said of the station there, against the row's median: the bump's own height
    goes with what the row's edge takes of it.
    """
    x_m = line.x_m
    widths_m = tried_m(pitch_m(x_m), float(np.ptp(x_m)))
    under = with_edges(x_m)
    for one in named:
        tried = [np.column_stack([under, shape(x_m, one.position_m, w)]) for w in widths_m]
        under = min(tried, key=lambda base: _left(line, base))
    for bump in find_bumps(line.levels(under), chance, most=1):
        near = min(abs(bump.x_m - one.position_m) for one in named)
        at = int(np.argmin(np.abs(x_m - bump.x_m)))
        higher_pa = float(line.level_pa[at] - np.median(line.level_pa))
        if min(bump.height, higher_pa) > 0 and near > widths_m[-1]:
            words = f"no pulse; {higher_pa:.0f} Pa stiffer"
            named = [*named, _doubted(line, bump.x_m, higher_pa, words)]
    return named


def _left(line: Pressed, base: Array) -> float:
    """What ``base`` leaves of a row's level, weighted and squared."""
    *_, left = weighted(line.levels(base), [])
    return float(left @ left)


def doubtful(
    lines: list[Pressed], least_pa: list[float], y_m: list[float], station_m: float
) -> list[ObjectFinding]:
    """What may be a lump in finished rows at ``y_m`` that show no object, undecided. Only rows that
    would not show a lump (`LUMP_SHARE`) are asked. ``least_pa``: each row's `least_bump_pa`;
    ``station_m``: the rows' pitch.

    A bump counts if its chance is below `DOUBT`, or if it is as high as a lump in a row that is
    more uneven than its presses scatter, since several lumps look like scatter. If no row has such
    a bump, the row with the largest curvature is reported, provided that it reaches half a lump's.
    A curved surface may have caused either, so a lump may lie anywhere in the row.
    """
    found: list[list[ObjectFinding]] = [[] for _ in lines]
    bent = []
    for line, least, here in zip(lines, least_pa, found, strict=True):
        lump_pa = LUMP_SHARE * level_of(line.level_pa)
        if len(line.x_m) < MIN_STATIONS or not least > lump_pa:
            continue
        row = line.levels(surroundings(line.x_m))
        chance = DOUBT / len(lines)
        high_pa = lump_pa if evenness(row) < chance else np.inf
        bumps = [
            bump for bump in find_bumps(row, false_alarm=1.0, most=1)
            if bump.p_value <= chance
            or abs(bump.height) > max(high_pa, NORMAL_95 * bump.height_sd)
        ]  # fmt: skip
        for bump in bumps:
            word = "stiffer" if bump.height > 0 else "softer"
            words = f"no pulse; {abs(bump.height):.0f} Pa {word}"
            here.append(_doubted(line, bump.x_m, bump.height, words))
        bent_pa, bent_sd_pa = _bent(line)
        # nearer to a lump than to none
        if not bumps and bent_pa > max(lump_pa / 2, NORMAL_95 * bent_sd_pa):
            words = f"no pulse; the row is bent as if by a lump of {bent_pa:.0f} Pa"
            bent.append(_doubted(line, float(np.median(line.x_m)), bent_pa, words))
    bumps_found = across_rows(list(zip(y_m, found, strict=True)), station_m)
    return bumps_found + sorted(bent, key=lambda one: one.peak_pa)[-1:]


def between_rows(lines: list[Pressed], y_m: list[float]) -> list[ObjectFinding]:
    """Of finished rows at ``y_m`` (n,) that show nothing: that one differs from a tilted surface
    through the others by as much as a lump, undecided: what lies along it is in no row a bump.

    Which one is said only if without it the others are as on a tilted surface.
    """
    if not np.isfinite(y_m).all() or len(lines) < MIN_ROWS:
        return []
    level_pa = np.array([level_of(line.level_pa) for line in lines])
    q, _ = np.linalg.qr(np.column_stack([np.ones(len(lines)), np.array(y_m) - np.mean(y_m)]))
    off_pa, held = level_pa - q @ (q.T @ level_pa), np.maximum(1 - (q**2).sum(axis=1), 1e-12)
    alone_pa = off_pa / held  # off the others' own surface (Cook and Weisberg 1982, section 2.2)
    left = 1 - off_pa * alone_pa / max(float(off_pa @ off_pa), 1e-300)  # of the squares, without it
    k = min(range(len(lines)), key=lambda i: (round(float(left[i]), 3), abs(alone_pa[i])))
    if abs(alone_pa[k]) < LUMP_SHARE * level_of(level_pa):
        return []
    word, x_m = "stiffer" if alone_pa[k] > 0 else "softer", lines[k].x_m
    where = f"the rows differ by up to {abs(alone_pa[k]):.0f} Pa more than on a tilted surface"
    if len(lines) > MIN_ROWS and left[k] < LEFT_WITHOUT:
        where = (
            f"the row at y = {1e3 * y_m[k]:.1f} mm is {abs(alone_pa[k]):.0f} Pa {word} than the "
            "others"
        )
    return [ObjectFinding(
        UNDECIDED, float(np.median(x_m)), (float(x_m[0]), float(x_m[-1])), float(alone_pa[k]),
        float(np.median(lines[k].pulse_pa)), 0.0,
        f"no pulse; {where}, as over something that lies along them or a curved surface: scan in "
        "rows across these",
    )]  # fmt: skip


def _doubted(line: Pressed, x_m: float, height_pa: float, words: str) -> ObjectFinding:
    at = int(np.argmin(np.abs(line.x_m - x_m)))
    return ObjectFinding(
        UNDECIDED, x_m, (float(line.x_m[0]), float(line.x_m[-1])), height_pa,
        float(line.pulse_pa[at]), 0.0,
        f"{words}, which {len(line.x_m)} stations cannot tell from a curved surface, a block's end "
        "or presses that differ: a longer row can",
    )  # fmt: skip


def _bent(line: Pressed) -> tuple[float, float]:
    """How high a bump in the middle, two station distances wide, bends a row as this one is bent,
    and its standard deviation [Pa]: of a short row it is the level's curvature."""
    x_m, sd = line.x_m, line.level_sd_pa
    square = np.linalg.pinv(surroundings(x_m) / sd[:, None])[2] / sd
    lump = float(square @ shape(x_m, float(x_m.mean()), 2 * pitch_m(x_m)))
    return float(square @ line.level_pa) / lump, float(np.linalg.norm(square * sd) / abs(lump))
