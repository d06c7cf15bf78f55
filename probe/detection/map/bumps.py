"""Local bumps and dips in a row of stations, against tilt, curvature, edges and scatter."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, fdtrc, fdtri, ncfdtrinc, stdtrit

from drivers.core.arrays import Array
from probe.detection.map.bump_doubts import doubts, other_shapes_sd_m
from probe.detection.map.bump_fit import refined, tried_m
from probe.detection.map.row_rivals import odds_of_one_press, odds_of_uneven_row
from probe.detection.map.row_shapes import OTHER_TAILS, TAIL, explained, shape, weighted
from probe.detection.repeats import pitch_m

PLACES_PER_PITCH = 4
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
"""Bumps of a row at most, and how many are looked for at once."""
MIN_STATIONS = 6
"""Stations that can show a bump apart from a background."""


@dataclass(frozen=True)
class Bump:
    """``height`` above (below, when negative) the background at ``x_m``, ``half_width_m`` wide.

    ``x_low_m``, ``x_high_m``: 95 % interval; ``p_value``: chance of one as clear anywhere in a row
    that has none; ``alone``: odds that only the press at it differs, against the bump; ``uneven``:
    odds that the row waves from end to end, that a high block's sides reach further in or that it
    is stiffer on one side.
    """

    x_m: float
    x_low_m: float
    x_high_m: float
    height: float
    height_sd: float
    half_width_m: float
    p_value: float
    alone: float = 0.0
    uneven: float = 0.0


@dataclass(frozen=True)
class Row:
    """The bumps of a row, strongest first, and the ``background`` (n,) under them."""

    bumps: tuple[Bump, ...]
    background: Array
    scatter: float


def find_bumps(
    x_m: Array, value: Array, sd: Array, base: Array, false_alarm: float, most: int = MAX_OBJECTS,
    *, rising: bool = False,
) -> Row:  # fmt: skip
    """Up to ``most`` bumps in ``value`` (n,) at ``x_m`` (n,), ascending; ``sd`` (n,) is at least
    their scatter.

    ``base`` (n, k) are the columns of what may lie under them: `surroundings` or `floor`.
    ``rising``: dips are none, as in a map of pulses, where what lies between two vessels is no
    object; and bumps may lie at the row's ends, where a level shows a block's edge. Fewer than 6
    stations cannot show a bump apart from a background: none are found.
    """
    n = len(x_m)
    if n < MIN_STATIONS:
        return Row((), np.full(n, np.median(value)), float(np.median(sd)))
    known: list[tuple[float, float]] = []
    chances: list[float] = []
    while len(known) < most and (left := n - base.shape[1] - 3 * len(known)) > 3:
        new, p_value = _next(x_m, value, sd, base, known, rising)
        # those that are equally clear hide each other: each looks like the others' scatter
        *_, rest = weighted(x_m, value, sd, base, known)
        before = float(rest @ rest)
        counts = range(2, min(TOGETHER, most - len(known), (left - 1) // 3) + 1)
        best = [_chance_together(n, left, before, 0.0, count) for count in counts]
        for k in range(len(counts)):
            if p_value <= false_alarm or min(best[k:]) > false_alarm:
                break
            new, p_value = _together(x_m, value, sd, base, known, new, rising, before)
        if p_value > false_alarm:
            break
        every = refined(x_m, value, sd, base, [*known, *new], rising)
        if len(new) == 1 and most - len(known) > 1 and left > 6:
            every = _or_two_beside(x_m, value, sd, base, known, new, rising, every)
        chances += [p_value] * (len(every) - len(known))
        known = every
    return _row(x_m, value, sd, base, known, chances, rising)


def least_height(x_m: Array, value: Array, sd: Array, base: Array, false_alarm: float) -> float:
    """The bump, two station distances wide, that nine of ten such rows would show in their middle;
    in the unit of ``value``, infinite where no bump could show."""
    n = len(x_m)
    if n < MIN_STATIONS or n - base.shape[1] <= 3:
        return float("inf")
    _, fitted, _, rest = weighted(x_m, value, sd, base, [])
    column = np.zeros(len(fitted))
    column[:n] = shape(x_m, float(x_m.mean()), 2 * pitch_m(x_m)) / sd
    q, _ = np.linalg.qr(fitted)
    column -= q @ (q.T @ column)
    one = -np.expm1(np.log1p(-false_alarm) / _independent(PLACES_PER_PITCH * (n - 2)))
    left = max(n - base.shape[1] - 3, 1) + TRUSTED
    wanted = float(ncfdtrinc(3, left, 0.1, fdtri(3, left, 1 - one)))
    scatter = max((float(rest @ rest) + TRUSTED) / (n - base.shape[1] + TRUSTED), 1.0)
    return float(np.sqrt(wanted * scatter / (column @ column)))


def evenness(x_m: Array, value: Array, sd: Array, base: Array) -> float:
    """How often ``base`` and a scatter of ``sd`` (n,) leave a row as uneven as ``value`` (n,)."""
    *_, left = weighted(x_m, value, sd, base, [])
    return float(chdtrc(len(x_m) - base.shape[1], float(left @ left)))


def at_places(x_m: Array, value: Array, sd: Array, base: Array, bumps: tuple[Bump, ...]) -> Row:
    """The same bumps' heights in another map of the same stations, their places kept."""
    if len(x_m) < MIN_STATIONS or not bumps:
        return Row((), np.full(len(x_m), np.median(value)), float(np.median(sd)))
    known = [(one.x_m, one.half_width_m) for one in bumps]
    return _row(x_m, value, sd, base, known, [1.0] * len(known), None)


def _next(
    x_m: Array, value: Array, sd: Array, base: Array,
    known: list[tuple[float, float]], rising: bool,
) -> tuple[list[tuple[float, float]], float]:  # fmt: skip
    """The clearest further bump and its chance."""
    pitch = pitch_m(x_m)
    end = 0.0 if rising else pitch
    inner = np.arange(x_m[0] + end, x_m[-1] - end + 1e-9, pitch / PLACES_PER_PITCH)
    free = [c for c in inner if all(abs(c - k[0]) >= MIN_DISTANCE * pitch for k in known)]
    widths_m = tried_m(pitch, float(np.ptp(x_m))).tolist()
    tried = [(float(c), w) for c in free for w in widths_m]
    if not tried:
        return [(float(x_m.mean()), pitch)], 1.0
    _, a, _, left = weighted(x_m, value, sd, base, known)
    shapes = np.column_stack([shape(x_m, *one) for one in tried])
    drop, height = explained(a, left, shapes / sd[:, None])
    if rising:
        drop[height < 0] = 0.0
    before, best = float(left @ left), int(np.argmax(drop))
    dof = len(x_m) - base.shape[1] - 3 * len(known)
    left_over = before - float(drop[best])
    return [tried[best]], chance(before, left_over, 3, dof, _independent(len(free)))


def _together(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]],
    new: list[tuple[float, float]], rising: bool, before: float,
) -> tuple[list[tuple[float, float]], float]:  # fmt: skip
    """``new`` bumps with the one that is clearest beside them, or in place of a single one the two
    beside it, and the chance of all together; ``before`` is the sum of squares without them."""
    more, _ = _next(x_m, value, sd, base, [*known, *new], rising)
    every = refined(x_m, value, sd, base, [*known, *new, *more], rising, steps=FEW_STEPS)
    *_, rest = weighted(x_m, value, sd, base, every)
    new, after = every[len(known) :], float(rest @ rest)
    if len(new) == 2:
        two, as_two = _two_beside(x_m, value, sd, base, known, new[:1], rising)
        new, after = (two, as_two) if as_two < after else (new, after)
    dof = len(x_m) - base.shape[1] - 3 * len(known)
    return new, _chance_together(len(x_m), dof, before, after, len(new))


def _chance_together(n: int, dof: int, before: float, after: float, count: int) -> float:
    """`chance` of ``count`` bumps at any of n stations."""
    places = (PLACES_PER_PITCH * n) ** count // PLACES_PER_PITCH ** (count - 1)
    return chance(before, after, 3 * count, dof, _independent(places))


def _or_two_beside(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]],
    new: list[tuple[float, float]], rising: bool, every: list[tuple[float, float]],
) -> list[tuple[float, float]]:  # fmt: skip
    """``every`` bump with the ``new`` one, or with the two beside it if they explain the row
    better, whatever ``new`` looks like: between two lumps a row dips, and two near each other look
    like one that is wide."""
    cost = COST_OF_TWO * np.log(len(x_m))
    *_, left = weighted(x_m, value, sd, base, every)
    if left @ left < cost:  # two that leave nothing would not be better
        return every
    two, as_two = _two_beside(x_m, value, sd, base, known, new, rising)
    dof = max(len(x_m) - base.shape[1] - 3 * (len(known) + 2), 1)
    most = as_two + cost * max((as_two + TRUSTED) / (dof + TRUSTED), 1.0)
    for tail in (TAIL, *OTHER_TAILS):
        one = every if tail == TAIL else refined(
            x_m, value, sd, base, [*known, *new], rising, tail
        )  # fmt: skip
        *_, left = weighted(x_m, value, sd, base, one, tail)
        if left @ left < most:
            return every
    return refined(x_m, value, sd, base, [*known, *two], rising)


def _two_beside(
    x_m: Array, value: Array, sd: Array, base: Array,
    known: list[tuple[float, float]], new: list[tuple[float, float]], rising: bool,
) -> tuple[list[tuple[float, float]], float]:  # fmt: skip
    """The two bumps on either side of a ``new`` one, and the sum of squares that they leave;
    infinite where one of them would be a dip."""
    ((at, width),) = new
    _, fitted, _, left = weighted(x_m, value, sd, base, known)
    q, _ = np.linalg.qr(fitted)
    off, half = (grid.ravel() for grid in np.meshgrid(BESIDE * width, BESIDE_WIDTHS * width))
    more = np.zeros((2, len(left), len(off)))
    for side, middle in enumerate((at - off, at + off)):
        more[side, : len(x_m)] = shape(x_m[:, None], middle, half) / sd[:, None]
        more[side] -= q @ (q.T @ more[side])
    gram = np.einsum("ink,jnk->kij", more, more)
    along = np.einsum("ink,n->ki", more, left)
    heights = np.linalg.solve(
        gram + RIDGE * gram.trace(axis1=1, axis2=2)[:, None, None] * np.eye(2), along[:, :, None]
    )[:, :, 0]
    gain = np.where(heights.min(axis=1) > 0, (along * heights).sum(axis=1), 0.0)
    k = int(np.argmax(gain))
    if gain[k] <= 0:
        return new, float("inf")
    two = [(at - off[k], half[k]), (at + off[k], half[k])]
    every = refined(x_m, value, sd, base, [*known, *two], rising, steps=FEW_STEPS)
    _, a, b, rest = weighted(x_m, value, sd, base, every)
    upward = (np.linalg.pinv(a) @ b)[base.shape[1] + len(known) :].min() > 0
    return every[len(known) :], float(rest @ rest) if upward else float("inf")


def chance(before: float, after: float, unknowns: int, dof: int, independent: float) -> float:
    """How often bumps with ``unknowns`` explain as much in a map of nothing, at any of so many
    ``independent`` places and widths."""
    # the scatter is what is left, but never less than what the stations themselves have
    left = max(dof - unknowns, 1) + TRUSTED
    scatter = max((after + TRUSTED) / left, 1.0)
    ratio = max(before - after, 0.0) / unknowns / scatter
    one = min(float(fdtrc(unknowns, left, ratio)), 1 - 1e-16)
    return float(-np.expm1(independent * np.log1p(-one)))


def _independent(places: int) -> float:
    """Of ``places`` tried, `PLACES_PER_PITCH` to each pitch, with all widths."""
    return 2 * max(places / PLACES_PER_PITCH, 1.0)


def _row(
    x_m: Array, value: Array, sd: Array, base: Array,
    known: list[tuple[float, float]], chances: list[float], rising: bool | None,
) -> Row:  # fmt: skip
    """``rising``: as in `find_bumps`; None where places and widths are known, from another map."""
    columns, a, b, left = weighted(x_m, value, sd, base, known)
    rss = float(left @ left)
    coefficients = np.linalg.pinv(a) @ b
    count = base.shape[1]
    dof = max(len(x_m) - count - 3 * len(known), 1)
    scatter = (rss + TRUSTED) / (dof + TRUSTED)
    heights = coefficients[count:]
    height_sd, place_sd = doubts(x_m, sd, a, known, heights, scatter, rising is None)
    if known and rising is not None:
        rest = other_shapes_sd_m(x_m, value, sd, base, known, rss, scatter, rising)
        place_sd = np.hypot(place_sd, rest)
    reach = float(stdtrit(dof + TRUSTED, 0.975)) * place_sd
    alone = [
        odds_of_one_press(x_m, value, sd, base, known, k, rss, scatter) for k in range(len(known))
    ]
    others = [
        odds_of_uneven_row(x_m, value, sd, base, known, k, rss, scatter) for k in range(len(known))
    ]
    bumps = [
        Bump(c, c - r, c + r, float(h), float(s), w, p, *odds)
        for (c, w), h, s, r, p, *odds in zip(
            known, heights, height_sd, reach, chances, alone, others, strict=True
        )
    ]
    bumps.sort(key=lambda b: b.p_value)
    return Row(tuple(bumps), columns[:, :count] @ coefficients[:count], float(np.sqrt(scatter)))
