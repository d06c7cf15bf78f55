"""Local bumps and dips in a map of stations, against tilt, curvature, edges and scatter."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, fdtrc, fdtri, ncfdtrinc, stdtrit

from drivers.core.arrays import Array
from probe.detection.map.area import among
from probe.detection.map.bump_doubts import doubts, other_shapes_sd_m
from probe.detection.map.bump_fit import refined, rim_of, tried_m
from probe.detection.map.rivals import odds_of_one_press, odds_of_uneven
from probe.detection.map.row_shapes import OTHER_TAILS, TAIL
from probe.detection.map.seen_map import Map, bump_at, explained, fallen, weighted

PLACES = 4
"""Centres that are tried for each station: four to a pitch, or two by two."""
TRUSTED = 5
"""How many stations' worth the stated scatter is believed against the one that is seen."""
MIN_DISTANCE = 1.5
"""Least distance between two objects, in station distances."""
BESIDE, BESIDE_WIDTHS = np.array([0.75, 1.5, 2.5]), np.array([0.5, 0.7, 1.0])
"""In half widths of a bump: from its middle to the two that it may be, and what theirs are."""
RIDGE = 1e-9
"""Over the squares of two bumps: keeps those that are one from being of any height."""
FEW_STEPS = 15
"""Of a fit that only asks whether several bumps are there: of 592 to what rows leave 99 in 100 come
within 1.9 of their least sum of squares by then, where a bump must explain about 25."""
COST_OF_TWO = 4
"""Logarithms of the stations by which two bumps must explain a row better than one: three unknowns
(Schwarz 1978), and one since any of `BESIDE` will do. In rows of 1, 2 and 4 mm none of 1,080 bumps
was taken for two (of three: 5), and all 180 pairs of pulses 15 mm from each other were two."""
MAX_OBJECTS, TOGETHER = 4, 3
"""Bumps of a map at most, and how many of a row are looked for at once."""
MIN_STATIONS = 6
"""Stations that can show a bump apart from a background."""
AT_ONCE = 1 << 19
"""Numbers in a table of what bumps make, 4 MB: at once all that 1,000 presses at random places may
show took 3.4 GB, and three times as long."""


@dataclass(frozen=True)
class Bump:
    """``height`` above (below, when negative) the ``background`` at ``place_m`` (d,), with the half
    width of its 95 % interval ``reach_m`` (d,); ``half_width_m`` wide.

    ``p_value``: chance of one as clear anywhere in a map that has none; ``alone``: odds that only
    the press at it differs, against the bump; ``uneven``: odds of what `odds_of_uneven` has.
    """

    place_m: Array
    reach_m: Array
    height: float
    height_sd: float
    half_width_m: float
    background: float
    p_value: float
    alone: float = 0.0
    uneven: float = 0.0

    @property
    def x_m(self) -> float:
        return float(self.place_m[0])

    @property
    def shape(self) -> Array:
        """As `bump_at` takes it."""
        return np.append(self.place_m, self.half_width_m)


def find_bumps(
    seen: Map, false_alarm: float, most: int = MAX_OBJECTS, *, rising: bool = False
) -> tuple[Bump, ...]:
    """Up to ``most`` bumps in a map, the strongest first; its ``sd`` is at least its scatter.

    ``rising``: dips are none, as in a map of pulses, where what lies between two vessels is no
    object; and bumps may lie at a row's ends, where a level shows a block's edge. Fewer than 6
    stations cannot show a bump apart from a background: none are found.
    """
    n = len(seen.value)
    known: list[Array] = []
    chances: list[float] = []
    if n < MIN_STATIONS or not seen.spacing_m > 0:
        return ()
    each = seen.unknowns
    while len(known) < most and (spare := n - seen.base.shape[1] - each * len(known)) > each:
        new, p_value = _next(seen, known, rising)
        # those of a row that are equally clear hide each other: each looks like the others'
        # scatter; in an area several along a line may be what a bone's edge is
        *_, rest = weighted(seen, known)
        before = float(rest @ rest)
        most_new = min(TOGETHER, most - len(known), (spare - 1) // each) if seen.is_row else 1
        counts = range(2, most_new + 1)
        best = [_chance_together(seen, spare, before, 0.0, count) for count in counts]
        for k in range(len(counts)):
            if p_value <= false_alarm or min(best[k:]) > false_alarm:
                break
            new, p_value = _together(seen, known, new, rising, before)
        if p_value > false_alarm:
            break
        bumps = refined(seen, [*known, *new], rising)
        if seen.is_row and len(new) == 1 and most - len(known) > 1 and spare > 2 * each:
            bumps = _or_two_beside(seen, known, new, rising, bumps)
        chances += [p_value] * (len(bumps) - len(known))
        known = bumps
    return _described(seen, known, chances, rising)


def least_height(seen: Map, false_alarm: float) -> float:
    """The bump, two station distances wide, that nine of ten such rows would show in their middle;
    in the unit of its value, infinite where no bump could show."""
    n, count = len(seen.value), seen.base.shape[1]
    if n < MIN_STATIONS or n - count <= 3:
        return float("inf")
    _, fitted, _, rest = weighted(seen, [])
    column = np.zeros(len(fitted))
    middle = np.append(seen.place_m.mean(axis=0), 2 * seen.spacing_m)
    column[:n] = bump_at(seen.place_m, middle) / seen.sd
    q, _ = np.linalg.qr(fitted)
    column -= q @ (q.T @ column)
    chance_each = -np.expm1(np.log1p(-false_alarm) / _independent(PLACES * (n - 2)))
    dof = max(n - count - 3, 1) + TRUSTED
    wanted = float(ncfdtrinc(3, dof, 0.1, fdtri(3, dof, 1 - chance_each)))
    scatter = max((float(rest @ rest) + TRUSTED) / (n - count + TRUSTED), 1.0)
    return float(np.sqrt(wanted * scatter / (column @ column)))


def evenness(seen: Map) -> float:
    """How often its base and a scatter of its ``sd`` leave a map as uneven as this one."""
    *_, residual = weighted(seen, [])
    return float(chdtrc(len(seen.value) - seen.base.shape[1], float(residual @ residual)))


def at_places(seen: Map, bumps: Iterable[Bump]) -> tuple[Bump, ...]:
    """The same bumps' heights in another map of the same stations, their places kept."""
    known = [bump.shape for bump in bumps]
    return _described(seen, known, [1.0] * len(known), None)


def _next(seen: Map, known: list[Array], rising: bool) -> tuple[list[Array], float]:
    """The clearest further bump and its chance."""
    pitch, n = seen.spacing_m, len(seen.value)
    centres = _centres(seen, rising)
    for bump in known:
        apart = np.sqrt(((centres - bump[:-1]) ** 2).sum(axis=1))
        centres = centres[apart >= MIN_DISTANCE * pitch]
    if not len(centres):
        return [np.append(seen.place_m.mean(axis=0), pitch)], 1.0
    width = tried_m(pitch, seen.span_m)
    _, a, _, residual = weighted(seen, known)
    before, most, best = float(residual @ residual), -1.0, centres[0]
    parts = min(-(-len(centres) * len(width) * n // AT_ONCE), len(centres))
    for part in np.array_split(centres, parts):
        square = ((seen.place_m[:, None] - part) ** 2).sum(axis=2)[:, :, None] / width**2
        drop, height = explained(a, residual, fallen(square).reshape(n, -1) / seen.sd[:, None])
        if rising:
            drop[height < 0] = 0.0
        k = int(np.argmax(drop))
        if drop[k] > most:
            most, best = float(drop[k]), np.append(part[k // len(width)], width[k % len(width)])
    dof = n - seen.base.shape[1] - seen.unknowns * len(known)
    p_value = chance(before, before - most, seen.unknowns, dof, _independent(len(centres)))
    return [best], p_value


def _centres(seen: Map, rising: bool) -> Array:
    """Places to try (c, d): along a row, or a grid among an area's presses."""
    rim_m, step_m = rim_of(seen, rising), seen.spacing_m * PLACES ** (-1 / seen.axes)
    low, high = seen.place_m.min(axis=0) + rim_m, seen.place_m.max(axis=0) - rim_m
    along = [np.arange(a, b + 1e-9, step_m) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*along), axis=-1).reshape(-1, seen.axes)
    return grid if seen.is_row else grid[among(grid, seen.place_m)]


def _together(
    seen: Map, known: list[Array], new: list[Array], rising: bool, before: float
) -> tuple[list[Array], float]:
    """``new`` bumps with the one that is clearest beside them, or in place of a single one the two
    beside it, and the chance of all together; ``before`` is the sum of squares without them."""
    more, _ = _next(seen, [*known, *new], rising)
    bumps = refined(seen, [*known, *new, *more], rising, steps=FEW_STEPS)
    *_, rest = weighted(seen, bumps)
    new, after = bumps[len(known) :], float(rest @ rest)
    if len(new) == 2:
        two, as_two = _two_beside(seen, known, new[0], rising)
        new, after = (two, as_two) if as_two < after else (new, after)
    dof = len(seen.value) - seen.base.shape[1] - seen.unknowns * len(known)
    return new, _chance_together(seen, dof, before, after, len(new))


def _chance_together(seen: Map, dof: int, before: float, after: float, count: int) -> float:
    """`chance` of ``count`` bumps at any of a map's stations."""
    places = (PLACES * len(seen.value)) ** count // PLACES ** (count - 1)
    return chance(before, after, seen.unknowns * count, dof, _independent(places))


def _or_two_beside(
    seen: Map, known: list[Array], new: list[Array], rising: bool, bumps: list[Array]
) -> list[Array]:
    """``every`` bump with the ``new`` one, or with the two beside it if they explain the row
    better, whatever ``new`` looks like: between two lumps a row dips, and two near each other look
    like one that is wide."""
    n = len(seen.value)
    cost = COST_OF_TWO * np.log(n)
    *_, residual = weighted(seen, bumps)
    if residual @ residual < cost:  # two that leave nothing would not be better
        return bumps
    two, as_two = _two_beside(seen, known, new[0], rising)
    dof = max(n - seen.base.shape[1] - 3 * (len(known) + 2), 1)
    most = as_two + cost * max((as_two + TRUSTED) / (dof + TRUSTED), 1.0)
    for tail in (TAIL, *OTHER_TAILS):
        fitted = bumps if tail == TAIL else refined(seen, [*known, *new], rising, tail)
        *_, residual = weighted(seen, fitted, tail)
        if residual @ residual < most:
            return bumps
    return refined(seen, [*known, *two], rising)


def _two_beside(
    seen: Map, known: list[Array], new: Array, rising: bool
) -> tuple[list[Array], float]:
    """The two bumps of a row on either side of a ``new`` one, and the sum of squares that they
    leave; infinite where one of them would be a dip."""
    at, width = new
    _, fitted, _, left = weighted(seen, known)
    q, _ = np.linalg.qr(fitted)
    off, half = (grid.ravel() for grid in np.meshgrid(BESIDE * width, BESIDE_WIDTHS * width))
    more = np.zeros((2, len(left), len(off)))
    for side, middle in enumerate((at - off, at + off)):
        square = ((seen.place_m - middle) / half) ** 2
        more[side, : len(seen.value)] = fallen(square) / seen.sd[:, None]
        more[side] -= q @ (q.T @ more[side])
    gram = np.einsum("ink,jnk->kij", more, more)
    along = np.einsum("ink,n->ki", more, left)
    heights = np.linalg.solve(
        gram + RIDGE * gram.trace(axis1=1, axis2=2)[:, None, None] * np.eye(2), along[:, :, None]
    )[:, :, 0]
    gain = np.where(heights.min(axis=1) > 0, (along * heights).sum(axis=1), 0.0)
    k = int(np.argmax(gain))
    if gain[k] <= 0:
        return [new], float("inf")
    two = [np.array([at - off[k], half[k]]), np.array([at + off[k], half[k]])]
    every = refined(seen, [*known, *two], rising, steps=FEW_STEPS)
    _, a, b, rest = weighted(seen, every)
    upward = (np.linalg.pinv(a) @ b)[seen.base.shape[1] + len(known) :].min() > 0
    return every[len(known) :], float(rest @ rest) if upward else float("inf")


def chance(before: float, after: float, unknowns: int, dof: int, independent: float) -> float:
    """How often bumps with ``unknowns`` explain as much in a map of nothing, at any of so many
    ``independent`` places and widths."""
    # the scatter is what is left, but never less than what the stations themselves have
    dof_left = max(dof - unknowns, 1) + TRUSTED
    scatter = max((after + TRUSTED) / dof_left, 1.0)
    ratio = max(before - after, 0.0) / unknowns / scatter
    once = min(float(fdtrc(unknowns, dof_left, ratio)), 1 - 1e-16)
    return float(-np.expm1(independent * np.log1p(-once)))


def _independent(places: int) -> float:
    """Of ``places`` tried, `PLACES` to each station, with all widths."""
    return 2 * max(places / PLACES, 1.0)


def _described(
    seen: Map, known: list[Array], chances: list[float], rising: bool | None
) -> tuple[Bump, ...]:
    """``rising``: as in `find_bumps`; None where places and widths are known, from another map."""
    if not known:
        return ()
    columns, a, b, residual = weighted(seen, known)
    n, count, rss = len(seen.value), seen.base.shape[1], float(residual @ residual)
    coefficients = np.linalg.pinv(a) @ b
    dof = max(n - count - seen.unknowns * len(known), 1)
    scatter = (rss + TRUSTED) / (dof + TRUSTED)
    heights, under = coefficients[count:], columns[:, :count] @ coefficients[:count]
    height_sd, place_sd = doubts(seen, a, known, heights, scatter, rising is None)
    if rising is not None:
        place_sd = np.hypot(place_sd, other_shapes_sd_m(seen, known, rss, scatter, rising))
    reach = float(stdtrit(dof + TRUSTED, 0.975)) * place_sd
    bumps = []
    for k, (bump, p_value) in enumerate(zip(known, chances, strict=True)):
        alone = uneven = 0.0
        if rising is False:  # of a pulse, only a vessel
            alone = odds_of_one_press(seen, known, k, rss, scatter)
            uneven = odds_of_uneven(seen, known, k, rss, scatter)
        nearest = int(np.argmin(((seen.place_m - bump[:-1]) ** 2).sum(axis=1)))
        bumps.append(Bump(
            bump[:-1], reach[k], float(heights[k]), float(height_sd[k]), float(bump[-1]),
            float(under[nearest]), p_value, alone, uneven,
        ))  # fmt: skip
    return tuple(sorted(bumps, key=lambda bump: bump.p_value))
