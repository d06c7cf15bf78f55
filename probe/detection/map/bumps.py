"""Local bumps and dips in a row of stations, against tilt, curvature, edges and scatter."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc, fdtrc, fdtri, ncfdtrinc, stdtrit

from drivers.core.arrays import Array

WIDTHS = (0.7, 1.0, 1.4, 2.0, 2.8)
"""Half widths that are tried, in station distances."""
PLACES_PER_PITCH = 4
EDGE_PITCHES, EDGE_M = 0.45, 1.8e-3
"""How far the free sides of a block lower its level (an exponential): in station distances, and at
least. Under the paper's finger a plane section of 16.8 mm shows 1.6 to 2.0 mm."""
CLOSE_M, FURTHER = 3e-3, (1.5, 2.0, 3.0, 4.0)
"""Stations that show how far a block's sides reach in, and what is tried over `EDGE_M`: a section
of 30 mm shows 3 times."""
CURVATURE, EDGE = 0.2, 0.3
"""Prior standard deviations over the level: of the square over the row's length, and of an edge."""
TRUSTED = 5
"""How many stations' worth the stated scatter is believed against the one that is seen."""
MIN_DISTANCE = 1.5
"""Least distance between two objects, in station distances."""
MAX_OBJECTS, TOGETHER = 4, 3
"""Bumps of a row at most, and how many are looked for at once."""
SETTLED = 1e-4
"""Of places and widths in station distances: a hundredth of what is ever known of them."""
NARROWEST, WIDEST = 0.45, 4.0
"""Half widths of a fit, in station distances; any between is as likely, in the logarithm."""
WIDTH_SD = float(np.log(WIDEST / NARROWEST) / np.sqrt(12))
LEFT_OUT, MAX_LOG_ODDS = 1e6, 10.0
"""Scatter over its own that leaves a station out of a fit; odds beyond these change no finding."""
MIN_TURNS, PITCHES_OF_A_WAVE, TURNS_STEP = 1.5, 2.5, 0.125
"""Of a wave along a row: fewer turns are its curvature, stations show none that is shorter, and two
that differ by less than the step part by an eighth of a turn at most."""
LEAST_LEVEL = 1e-6
"""Over the largest: a row that is as uneven as this shows that nothing is pressed."""
MIN_STATIONS = 6
"""Stations that can show a bump apart from a background."""
MIN_LEVELS = 7
"""Stations that can show one apart from a tilted and curved background, as `surroundings`."""
MIN_WITH_EDGES = 9
"""Stations that can show one apart from a block's edges too: its three unknowns, and five more."""


@dataclass(frozen=True)
class Bump:
    """``height`` above (below, when negative) the background at ``x_m``, ``half_width_m`` wide.

    ``x_low_m``, ``x_high_m``: 95 % interval; ``p_value``: chance of one as clear anywhere in a row
    that has none; ``alone``: odds that only the press at it differs, against the bump; ``wave``:
    odds that the row waves from end to end, as an uneven surface does, or that a high block's sides
    reach further in.
    """

    x_m: float
    x_low_m: float
    x_high_m: float
    height: float
    height_sd: float
    half_width_m: float
    p_value: float
    alone: float = 0.0
    wave: float = 0.0


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
    pitch = float(np.median(np.diff(x_m)))
    known: list[tuple[float, float]] = []
    chances: list[float] = []
    while len(known) < most and (left := n - base.shape[1] - 3 * len(known)) > 3:
        new, p_value = _next(x_m, value, sd, pitch, base, known, rising)
        # those that are equally clear hide each other: each looks like the others' scatter
        for _ in range(2, min(TOGETHER, most - len(known), (left - 1) // 3) + 1):
            if p_value <= false_alarm:
                break
            new, p_value = _together(x_m, value, sd, pitch, base, known, new, rising)
        if p_value > false_alarm:
            break
        known = _refined(x_m, value, sd, pitch, base, [*known, *new], rising)
        chances += [p_value] * len(new)
    return _row(x_m, value, sd, base, known, chances)


def least_height(x_m: Array, value: Array, sd: Array, base: Array, false_alarm: float) -> float:
    """The bump, two station distances wide, that nine of ten such rows would show in their middle;
    in the unit of ``value``, infinite where no bump could show."""
    n = len(x_m)
    if n < MIN_STATIONS or n - base.shape[1] <= 3:
        return float("inf")
    pitch = float(np.median(np.diff(x_m)))
    _, fitted, _, rest = _weighted(x_m, value, sd, base, [])
    column = np.zeros(len(fitted))
    column[:n] = shape(x_m, float(x_m.mean()), 2 * pitch) / sd
    q, _ = np.linalg.qr(fitted)
    column -= q @ (q.T @ column)
    one = -np.expm1(np.log1p(-false_alarm) / _independent(PLACES_PER_PITCH * (n - 2)))
    left = max(n - base.shape[1] - 3, 1) + TRUSTED
    wanted = float(ncfdtrinc(3, left, 0.1, fdtri(3, left, 1 - one)))
    scatter = max((float(rest @ rest) + TRUSTED) / (n - base.shape[1] + TRUSTED), 1.0)
    return float(np.sqrt(wanted * scatter / (column @ column)))


def evenness(x_m: Array, value: Array, sd: Array, base: Array) -> float:
    """How often ``base`` and a scatter of ``sd`` (n,) leave a row as uneven as ``value`` (n,)."""
    *_, left = _weighted(x_m, value, sd, base, [])
    return float(chdtrc(len(x_m) - base.shape[1], float(left @ left)))


def at_places(x_m: Array, value: Array, sd: Array, base: Array, bumps: tuple[Bump, ...]) -> Row:
    """The same bumps' heights in another map of the same stations, their places kept."""
    if len(x_m) < MIN_STATIONS or not bumps:
        return Row((), np.full(len(x_m), np.median(value)), float(np.median(sd)))
    known = [(one.x_m, one.half_width_m) for one in bumps]
    return _row(x_m, value, sd, base, known, [1.0] * len(known), fixed=True)


def shape(x_m: Array, centre: Array | float, half_width: Array | float) -> Array:
    """The bump that an inclusion makes: between a Gaussian and a Lorentzian."""
    return np.asarray((1 + ((x_m - centre) / half_width) ** 2 / 1.5) ** -1.5)


def surroundings(x_m: Array) -> Array:
    """Columns (n, 3 or 5) of a tilted, curved level, of 9 stations or more also its two edges."""
    columns = with_edges(x_m)
    return columns if len(x_m) >= MIN_WITH_EDGES else columns[:, :3]


def with_edges(x_m: Array) -> Array:
    """Columns (n, 5) of a tilted, curved level and of its two edges."""
    pitch = float(np.median(np.diff(x_m)))
    u = (x_m - x_m.mean()) / np.ptp(x_m)
    reach_m = max(EDGE_PITCHES * pitch, EDGE_M)
    edges = [np.exp(-np.abs(x_m - end) / reach_m) for end in (x_m[0], x_m[-1])]
    return np.column_stack([np.ones_like(u), u, u**2, *edges])


def _further_edges(x_m: Array) -> list[Array]:
    """Pairs of columns (n, 2) of edges that reach further, as a high block's do, where stations are
    so close that they show the difference from a lump."""
    if round(float(np.median(np.diff(x_m))), 4) > CLOSE_M:  # to what poses are exact to, 0.1 mm
        return []
    ends = x_m[[0, -1]]
    return [np.exp(-np.abs(x_m[:, None] - ends) / (more * EDGE_M)) for more in FURTHER]


def floor(x_m: Array) -> Array:
    """The column (n, 1) of what noise alone makes of a size: the same everywhere."""
    return np.ones((len(x_m), 1))


def level_of(value: Array) -> float:
    """The usual one, above 0 also where a sensor reads less than none."""
    return max(float(np.median(value)), LEAST_LEVEL * float(np.abs(value).max())) or 1.0


def _weighted(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]]
) -> tuple[Array, Array, Array, Array]:
    """Columns, and weighted with what holds them: columns, values, residual."""
    columns = np.column_stack([base, *(shape(x_m, *one) for one in known)])
    held = np.array([0.0, 0.0, 1 / CURVATURE, 1 / EDGE, 1 / EDGE])[: base.shape[1]]
    prior = np.diag(np.append(held, np.zeros(len(known)))) / level_of(value)
    a, b = np.vstack([columns / sd[:, None], prior]), np.append(value / sd, np.zeros(len(prior)))
    q, _ = np.linalg.qr(a)
    return columns, a, b, b - q @ (q.T @ b)


def _next(
    x_m: Array, value: Array, sd: Array, pitch: float, base: Array,
    known: list[tuple[float, float]], rising: bool,
) -> tuple[list[tuple[float, float]], float]:  # fmt: skip
    """The clearest further bump and its chance."""
    end = 0.0 if rising else pitch
    inner = np.arange(x_m[0] + end, x_m[-1] - end + 1e-9, pitch / PLACES_PER_PITCH)
    free = [c for c in inner if all(abs(c - k[0]) >= MIN_DISTANCE * pitch for k in known)]
    tried = [(float(c), w * pitch) for c in free for w in WIDTHS]
    if not tried:
        return [(float(x_m.mean()), pitch)], 1.0
    _, a, _, left = _weighted(x_m, value, sd, base, known)
    more = np.zeros((len(left), len(tried)))
    more[: len(x_m)] = np.column_stack([shape(x_m, *one) for one in tried]) / sd[:, None]
    q, _ = np.linalg.qr(a)
    more -= q @ (q.T @ more)
    along = left @ more
    drop = along**2 / np.maximum((more**2).sum(axis=0), 1e-300)
    if rising:
        drop[along < 0] = 0.0
    before, best = float(left @ left), int(np.argmax(drop))
    dof = len(x_m) - base.shape[1] - 3 * len(known)
    left_over = before - float(drop[best])
    return [tried[best]], chance(before, left_over, 3, dof, _independent(len(free)))


def _together(
    x_m: Array, value: Array, sd: Array, pitch: float, base: Array,
    known: list[tuple[float, float]], new: list[tuple[float, float]], rising: bool,
) -> tuple[list[tuple[float, float]], float]:  # fmt: skip
    """``new`` bumps with the one that is clearest beside them, and the chance of all together."""
    more, _ = _next(x_m, value, sd, pitch, base, [*known, *new], rising)
    every = _refined(x_m, value, sd, pitch, base, [*known, *new, *more], rising)
    *_, before = _weighted(x_m, value, sd, base, known)
    *_, after = _weighted(x_m, value, sd, base, every)
    count = len(new) + 1
    places = (PLACES_PER_PITCH * len(x_m)) ** count // PLACES_PER_PITCH ** (count - 1)
    dof = len(x_m) - base.shape[1] - 3 * len(known)
    all_new = chance(float(before @ before), float(after @ after), 3 * count, dof,
                      _independent(places))  # fmt: skip
    return every[len(known) :], all_new


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


def _refined(
    x_m: Array, value: Array, sd: Array, pitch: float, base: Array,
    known: list[tuple[float, float]], rising: bool,
) -> list[tuple[float, float]]:  # fmt: skip
    """Places and widths of all bumps together, by least squares."""
    n = len(x_m)
    _, a, _, left = _weighted(x_m, value, sd, base, [])
    q, _ = np.linalg.qr(a)

    def beside(columns: Array) -> Array:
        """What the base cannot explain of columns (n, k), weighted, above its prior's rows."""
        whole = np.zeros((len(a), columns.shape[1]))
        whole[:n] = columns / sd[:, None]
        return np.asarray(whole - q @ (q.T @ whole))

    def bumps(p: Array) -> tuple[Array, Array, Array]:
        """The bumps beside the base, an orthonormal basis of them, and what both leave."""
        shapes = np.column_stack([shape(x_m, c, w) for c, w in _bumps(p, pitch)])
        own = beside(shapes)
        basis, _ = np.linalg.qr(own)
        return own, basis, left - basis @ (basis.T @ left)

    def residual(p: Array) -> Array:
        return bumps(p)[2][:n]

    def jacobian(p: Array) -> Array:
        """Of variable projection (Golub and Pereyra 1973)."""
        own, basis, rest = bumps(p)
        inverse = np.linalg.pinv(own)
        height = np.repeat(inverse @ left, 2)
        moved = beside(np.column_stack([_moved(x_m, c, w) for c, w in _bumps(p, pitch)]))
        across = moved - basis @ (basis.T @ moved)
        found = across * height + np.repeat(inverse.T, 2, axis=1) * (rest @ moved)
        return -found[:n]

    start = np.array([v for c, w in known for v in (c, np.log(w / pitch))])
    end = 0.0 if rising else pitch / 2
    low = np.tile([x_m[0] + end, np.log(NARROWEST)], len(known))
    high = np.tile([x_m[-1] - end, np.log(WIDEST)], len(known))
    found = least_squares(residual, np.clip(start, low + 1e-9, high - 1e-9), jacobian,
                          bounds=(low, high), x_scale=np.tile([pitch, 0.3], len(known)),
                          xtol=SETTLED, ftol=SETTLED**2)  # fmt: skip
    return _bumps(found.x, pitch)


def _bumps(p: Array, pitch: float) -> list[tuple[float, float]]:
    """Places and widths out of places and logarithms of widths in pitches."""
    return list(zip(p[::2].tolist(), (pitch * np.exp(p[1::2])).tolist(), strict=True))


def _moved(x_m: Array, centre: float, half_width: float) -> Array:
    """Derivatives (n, 2) of `shape` by its place and the logarithm of its width."""
    u = (x_m - centre) / half_width
    slope = 2 * u * (1 + u**2 / 1.5) ** -2.5
    return np.column_stack([slope / half_width, slope * u])


def _row(
    x_m: Array, value: Array, sd: Array, base: Array,
    known: list[tuple[float, float]], chances: list[float], *, fixed: bool = False,
) -> Row:  # fmt: skip
    """``fixed``: places and widths are known, from another map."""
    columns, a, b, left = _weighted(x_m, value, sd, base, known)
    rss = float(left @ left)
    coefficients = np.linalg.pinv(a) @ b
    count = base.shape[1]
    dof = max(len(x_m) - count - 3 * len(known), 1)
    scatter = (rss + TRUSTED) / (dof + TRUSTED)
    heights = coefficients[count:]
    height_sd, place_sd = _doubts(x_m, sd, a, known, heights, scatter, fixed)
    reach = float(stdtrit(dof + TRUSTED, 0.975)) * place_sd
    alone = [_alone(x_m, value, sd, base, known, k, rss, scatter) for k in range(len(known))]
    waves = [_waving(x_m, value, sd, base, known, k, rss, scatter) for k in range(len(known))]
    bumps = [
        Bump(c, c - r, c + r, float(h), float(s), w, p, *odds)
        for (c, w), h, s, r, p, *odds in zip(
            known, heights, height_sd, reach, chances, alone, waves, strict=True
        )
    ]
    bumps.sort(key=lambda b: b.p_value)
    return Row(tuple(bumps), columns[:, :count] @ coefficients[:count], float(np.sqrt(scatter)))


def _alone(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]], k: int,
    rss: float, scatter: float,
) -> float:  # fmt: skip
    """Odds that the press nearest to the bump ``known[k]`` differs by itself, both alike
    beforehand: the likelihood without the press and the bump over that with them, ``rss``."""
    left_out = np.abs(x_m - known[k][0]) == np.abs(x_m - known[k][0]).min()
    *_, left = _weighted(
        x_m, value, np.where(left_out, LEFT_OUT * sd, sd), base, [*known[:k], *known[k + 1 :]]
    )
    return float(np.exp(min((rss - float(left @ left)) / (2 * max(scatter, 1.0)), MAX_LOG_ODDS)))


def _waving(
    x_m: Array, value: Array, sd: Array, base: Array, known: list[tuple[float, float]], k: int,
    rss: float, scatter: float,
) -> float:  # fmt: skip
    """Odds that the row waves, or that its edges reach further, instead of the bump ``known[k]``,
    or of all ``known``, alike beforehand: by likelihood, each unknown less for half the logarithm
    of the stations (Schwarz 1978). Waves and edges have three, as a bump does."""
    n, best, span = len(x_m), -np.inf, float(np.ptp(x_m))
    most_turns = span / float(np.median(np.diff(x_m))) / PITCHES_OF_A_WAVE
    for others in {(*known[:k], *known[k + 1 :]), ()}:
        _, a, b, _ = _weighted(x_m, value, sd, base, list(others))
        fewer = 3 * (len(known) - 1 - len(others))
        angles = [
            2 * np.pi * turns * (x_m - x_m[0]) / span
            for turns in np.arange(MIN_TURNS, most_turns, TURNS_STEP)
        ]
        waves = [np.column_stack([np.cos(angle), np.sin(angle)]) for angle in angles]
        for along in [*waves, *_further_edges(x_m)]:
            both = np.zeros((len(a), 2))
            both[:n] = along / sd[:, None]
            q, _ = np.linalg.qr(np.hstack([a, both]))
            left = b - q @ (q.T @ b)
            gain = (rss - float(left @ left)) / (2 * max(scatter, 1.0)) + fewer * np.log(n) / 2
            best = max(best, gain)
    return float(np.exp(min(best, MAX_LOG_ODDS)))


def _doubts(
    x_m: Array, sd: Array, fitted: Array, known: list[tuple[float, float]], heights: Array,
    scatter: float, fixed: bool,
) -> tuple[Array, Array]:  # fmt: skip
    """Standard deviations (k,) of heights and of places. Columns ``fitted`` are of the base and all
    heights; unless ``fixed``, places and widths are as unknown: a wider bump may be higher."""
    n, count, each = len(x_m), fitted.shape[1], len(known)
    half = np.array([w for _, w in known])
    whole = np.zeros((len(fitted) + each, count + 2 * each))
    whole[: len(fitted), :count] = fitted
    if known and not fixed:
        moved = np.array([h * _moved(x_m, *one) for one, h in zip(known, heights, strict=True)])
        whole[:n, count : count + each] = (half[:, None] * moved[:, :, 0] / sd).T
        whole[:n, count + each :] = (moved[:, :, 1] / sd).T
        whole[len(fitted) :, count + each :] = np.eye(each) * np.sqrt(scatter) / WIDTH_SD
    spread = np.sqrt(scatter * np.diag(np.linalg.pinv(whole.T @ whole)))
    return spread[count - each : count], half * spread[count : count + each]
