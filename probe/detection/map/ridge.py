"""A vessel's path through a map of presses at any places: a line of pulses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.core.arrays import Array
from probe.core.finding_words import NORMAL_95
from probe.detection.finding import ObjectFinding
from probe.detection.map.area import among
from probe.detection.map.bump_fit import tried_m
from probe.detection.map.bumps import PLACES, TRUSTED, Bump, chance
from probe.detection.map.rivals import TURNS_RAD
from probe.detection.map.row_shapes import shape
from probe.detection.map.seen_map import Map, bump_at, explained, weighted
from probe.detection.repeats import distinct_m

MIN_ODDS = 19.0
"""Of a line against bumps, to call it one: 95 %."""


@dataclass(frozen=True)
class Ridge:
    """The straight line at ``angle_rad`` to x, ``at_m`` aside of the origin, with the half width
    of that one's 95 % interval ``reach_m``; ``half_width_m``, ``height`` and ``p_value`` as a
    `Bump` has them. ``course_m`` (k, 2): where it crosses the presses' rows or columns."""

    angle_rad: float
    at_m: float
    reach_m: float
    half_width_m: float
    height: float
    height_sd: float
    p_value: float
    course_m: Array

    def away_m(self, place_m: Array) -> Array:
        """How far presses (n, 2) are aside of it, (n,) or one of one."""
        return np.asarray(np.abs(_across(place_m, self.angle_rad) - self.at_m))

    def along_rows(self) -> bool:
        """Whether it is nearer to the direction of rows, x, than to y."""
        return bool(abs(np.cos(self.angle_rad)) > abs(np.sin(self.angle_rad)))

    def shape(self, place_m: Array) -> Array:
        """What it makes at presses (n, 2), for a height of 1."""
        return shape(_across(place_m, self.angle_rad), self.at_m, self.half_width_m)


def find_ridge(seen: Map, bumps: Sequence[Bump]) -> Ridge | None:
    """The line that explains ``seen``; None where ``bumps``, each as if over a ball, do as well. It
    has as many unknowns as a ball: direction, place, width and height.

    By likelihood, each unknown less for half the logarithm of the presses (Schwarz 1978).
    """
    if not bumps or seen.spacing_m <= 0:
        return None
    balls = [bump_at(seen.place_m, one.shape) for one in bumps]
    as_balls, *_ = _fit(seen, np.column_stack(balls))
    as_line, tried = _best_line(seen)
    count, known = len(seen.value), seen.unknowns + seen.base.shape[1]
    scatter = max((as_line + TRUSTED) / (count - known + TRUSTED), 1.0)
    fewer = seen.unknowns * (len(bumps) - 1) * np.log(count)
    if (as_balls - as_line) / scatter + fewer < 2 * np.log(MIN_ODDS):
        return None
    angle, at, width = tried
    across = _across(seen.place_m, angle)
    _, height, height_sd = _fit(seen, shape(across, at, width)[:, None])
    alone, *_ = _fit(seen, np.empty((count, 0)))
    lines = len(TURNS_RAD) / PLACES * np.ptp(across) / seen.spacing_m
    p_value = chance(alone, as_line, seen.unknowns, count - seen.base.shape[1], round(lines))
    near = at + seen.spacing_m * np.linspace(-1, 1, 81)
    left = [_fit(seen, shape(across, one, width)[:, None])[0] for one in near.tolist()]
    inside = near[np.array(left) < as_line + NORMAL_95**2 * scatter].tolist()
    reach = max(abs(one - at) for one in [*inside, at + seen.spacing_m / 80])
    course = _crossed(seen.place_m, angle, at)
    if len(course) < 2:
        return None
    sd = float(np.sqrt(scatter)) * height_sd
    return Ridge(angle, at, reach, width, height, sd, p_value, course)


def _best_line(seen: Map) -> tuple[float, tuple[float, float, float]]:
    """What the best line that rises leaves of the map; its direction, place and half width."""
    _, a, _, rest = weighted(seen, [])
    widths = tried_m(seen.spacing_m, seen.span_m)
    most, tried = 0.0, (0.0, 0.0, 0.0)
    for angle in TURNS_RAD.tolist():
        across = _across(seen.place_m, angle)
        at = np.arange(across.min(), across.max(), seen.spacing_m / PLACES)
        lines = shape(across[:, None, None], at[:, None], widths).reshape(len(across), -1)
        drop, height = explained(a, rest, lines / seen.sd[:, None])
        drop[height < 0] = 0.0
        k = int(np.argmax(drop))
        if drop[k] > most:
            place, width = np.unravel_index(k, (len(at), len(widths)))
            most, tried = float(drop[k]), (angle, float(at[place]), float(widths[width]))
    return float(rest @ rest) - most, tried


def on_ridge(seen: Map, ridge: Ridge, place_m: Array) -> Bump:
    """The height of ``ridge`` in another map, as that of a bump at ``place_m`` (2,)."""
    left, height, sd = _fit(seen, ridge.shape(seen.place_m)[:, None])
    scatter = max((left + TRUSTED) / (len(seen.value) + TRUSTED), 1.0)
    nearest = int(np.argmin(np.hypot(*(seen.place_m - place_m).T)))
    under = float(seen.value[nearest] - height * ridge.shape(seen.place_m)[nearest])
    reach = np.full(2, ridge.reach_m)
    return Bump(place_m, reach, height, sd * float(np.sqrt(scatter)), ridge.half_width_m, under,
                ridge.p_value)  # fmt: skip


def with_course(one: ObjectFinding, ridge: Ridge) -> ObjectFinding:
    """The object with the ridge's course; along rows it lies anywhere from end to end."""
    points = tuple((float(x), float(y)) for x, y in ridge.course_m)
    ends = min(x for x, _ in points), max(x for x, _ in points)
    if ridge.along_rows():
        return replace(one, course=points, position_m=sum(ends) / 2, position_ci_m=ends)
    return replace(one, course=points)


def _across(place_m: Array, angle: float) -> Array:
    return np.asarray(place_m @ np.array([-np.sin(angle), np.cos(angle)]))


def _fit(seen: Map, columns: Array) -> tuple[float, float, float]:
    """What the map's base and ``columns`` (n, k) leave of it, weighted and squared; the last one's
    height and its standard deviation."""
    free = np.append(seen.prior_weight, np.zeros(columns.shape[1]))
    whole = replace(seen, base=np.column_stack([seen.base, columns]), prior_weight=free)
    _, a, b, left = weighted(whole, [])
    last = np.linalg.pinv(a)[-1]
    return float(left @ left), float(last @ b), float(np.linalg.norm(last))


def _crossed(place_m: Array, angle: float, at: float) -> Array:
    """Where the line crosses the presses' rows, or columns if it runs along rows, among them."""
    normal = np.array([-np.sin(angle), np.cos(angle)])
    along, aside = (1, 0) if abs(normal[0]) > abs(normal[1]) else (0, 1)
    places = distinct_m(place_m[:, along])
    if 2 * len(places) > len(place_m):  # no grid: the ends give the line
        places = np.linspace(places[0], places[-1], 9)
    points = np.empty((len(places), 2))
    points[:, along] = places
    points[:, aside] = (at - normal[along] * places) / normal[aside]
    return points[among(points, place_m)]
