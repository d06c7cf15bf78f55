"""The search for a pulse in a hold: how well one explains it at each possible heart rate."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import chdtri, fdtrc

from drivers.core.arrays import Array, Bools, Ints
from probe.detection.pulse.fit import Design, Fit, design_of, fit, harmonics
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import Noise, family
from probe.detection.pulse.possible_rates import (
    FASTEST_HZ,
    SLOWEST_HZ,
    anywhere,
    rates_hz,
    weights,
)
from probe.detection.pulse.wave import AMPLITUDES_MMHG, PHASES_RAD, SWING_MMHG

BEYOND_HZ, MIN_TURNS = (20 / 60, 300 / 60), 1.5
"""Rates that are looked at beside those, to say so, and turns that a hold must have of them."""
TESTED_HARMONICS = 2
"""Harmonics that decide whether there is a pulse: they carry nine tenths of its power."""
MOST_SECOND = 1.0
"""Largest second harmonic over the first: radial and brachial waves have 0.4 to 0.8."""
SHAPE_HARMONICS = 3
"""Of the brachial wave, what a pulse looks like to the test. Knowing the shape leaves two unknowns,
size and phase, instead of four."""
PHASES = 24
CHOICE = 0.66
"""Mean increase of a chi-square of two degrees of freedom from taking the best of `PHASES`; its
variance is unchanged (400,000 holds of white noise)."""
SHARE = {"shaped": 0.7, "free": 0.2, "train": 0.1}
"""Of the chance of a false pulse, what each way of finding one may spend: a wave of the known
shape, any two harmonics, a train of beats. Any shares that add up to 1 keep the chance; most pulses
are steady and nearly of the known shape, and those that are not are seldom faint."""
FINEST = 0.4
"""Harmonics above this share of the sampling rate are not looked at: mains hum folds there."""
SHORT = 20
"""Samples below which only the fundamental is looked for."""
FAR_BEHIND = 10.0
"""Log likelihood by which a noise may trail the best, with a pulse and without one, before it is
left out of both sums: each then is wrong by less than 14 exp(-10)."""
MOST_KEPT = 1 << 18
"""Numbers in one table of harmonics, 2 MB: the 52 that are kept for a scan's other holds take 100
MB. A longer hold is looked at for some rates at once, and nothing of it is kept."""
EVEN_BINS = 0.1
"""Of a step: how far samples may stray from even ones to be looked at as even ones."""


KEPT_HOLDS = 128
"""Holds whose looks are kept, for the noise that they share and for their own search: 0.3 MB each
of 1.7 s."""

Prior = Mapping[str, float]
"""Log probability of each noise, by its name."""


@dataclass(frozen=True)
class Search:
    """What a hold says of a pulse at ``rates_hz`` (r,).

    ``noises[m]`` is the log posterior of noise model m given no pulse, most likely first. A pulse
    of the known shape and of ``size`` [Pa], trough to crest, has the log likelihood ratio ``size *
    along - size**2 * power / 2`` in each noise, at each rate and phase (m, r, PHASES). ``clear``
    (r,) is the chi-square (2 degrees of freedom without a pulse) that its best size and phase
    explain. ``p_value`` is the chance of a pulse as clear at any rate and of any shape where there
    is none, ``rate_hz`` the clearest rate. ``gain`` (r,) is the log likelihood ratio of any two
    harmonics in white noise. ``noise`` is the most likely noise model given a pulse. ``dof`` are
    the degrees of freedom that ``clear`` was judged by.
    """

    rates_hz: Array
    noises: Array
    along: Array
    power: Array
    clear: Array
    gain: Array
    rate_hz: float
    p_value: float
    span_s: float
    noise: Noise
    dof: int


def search(hold: Hold, prior: Prior | None = None) -> tuple[Search, Fit]:
    """Look for a pulse, and the fit without one in white noise.

    ``prior`` is the log probability of each noise of the family before this hold was seen, by name;
    without it all are equally likely. A noise that it does not name is as unlikely as any that it
    names.

    It passes as a wave of the known shape or as any first two harmonics, each in its `SHARE` of the
    chance (Bonferroni's inequality with weights; Holm 1979). The likelihoods with and without a
    pulse are each summed over the family of noises, so that noise is never fitted to what holds a
    pulse.
    """
    looks, null = looks_at_hearts(hold)
    rates, n = rates_hz(hold.span_s), len(hold.time_s)
    each = looks.without
    if prior is not None:  # a part of a hold may have noises that whole holds cannot tell apart
        least = min(prior.values())
        each = each + np.array([prior.get(m.name, least) for m in looks.noises])
    without = np.logaddexp.reduce(each)
    shaped, free = (
        np.maximum(np.logaddexp.reduce(each[:, None] + gain) - without, 0.0)
        for gain in (looks.shaped, looks.free)
    )
    dof, lost = max(null.dof, 4 + 2 * TESTED_HARMONICS), 2 * TESTED_HARMONICS
    chosen = np.maximum(shaped - CHOICE / 2 * (n >= SHORT), 0.0)
    chances = _single(chosen, 2, dof - 2), _single(free, lost, dof - lost)
    ways = (chances[0], shaped, SHARE["shaped"]), (chances[1], free, SHARE["free"])
    weight = weights(rates)
    best, gain, share = min(ways, key=lambda way: (way[0] / weight).min() / way[2])
    likely = np.argsort(-(each + looks.shaped.max(axis=1)), kind="stable")
    return Search(
        rates, each[likely] - without, looks.along[likely], looks.power[likely],
        np.asarray(chdtri(2, np.maximum(chances[0], 1e-300))),
        looks.free[0], float(rates[int(np.argmax(gain))]),  # chances may all be 0.0
        min(1.0, anywhere(float((best / weight).min()), hold.span_s) / share), hold.span_s,
        looks.noises[likely[0]], dof,
    ), null  # fmt: skip


def beyond(hold: Hold) -> tuple[float, float]:
    """What beats slower or faster than hearts are looked for: its rate [Hz] and the chance of one
    as clear in a hold without any."""
    finest = FINEST * (len(hold.time_s) - 1) / max(hold.span_s, 1e-9)
    ranges = [(max(BEYOND_HZ[0], MIN_TURNS / hold.span_s), SLOWEST_HZ),
              (FASTEST_HZ, min(BEYOND_HZ[1], finest))]  # fmt: skip
    rates = np.concatenate([
        np.linspace(low, high, max(4, int(4 * (high - low) * hold.span_s)))
        for low, high in ranges if high > low
    ] or [np.empty(0)])  # fmt: skip
    if not len(rates):
        return float("nan"), 1.0
    design = design_of(hold)
    null = fit(hold, design, np.empty((len(hold.time_s), 0)))
    looks = _looks(hold, design, null, rates, 0)
    without = np.logaddexp.reduce(looks.without)
    gain = np.logaddexp.reduce(looks.without[:, None] + looks.free) - without
    lost = 2 * TESTED_HARMONICS
    chance = _single(np.maximum(gain, 0.0), lost, max(null.dof, 4 + lost) - lost)
    wide = sum(max(high - low, 0.0) for low, high in ranges)
    independent = 2 + 2 * wide * hold.span_s
    best = int(np.argmin(chance))
    return float(rates[best]), float(min(1.0, independent * chance[best]))


@lru_cache(maxsize=KEPT_HOLDS)
def looks_at_hearts(hold: Hold) -> tuple["Looks", Fit]:
    """The hold at each rate of hearts in each noise that counts, and its fit without a pulse."""
    design = design_of(hold)
    null = fit(hold, design, np.empty((len(hold.time_s), 0)))
    return _looks(hold, design, null, rates_hz(hold.span_s), PHASES), null


@dataclass(frozen=True)
class Looks:
    """The hold in each of ``noises`` (m,), the white one first: log likelihood ``without`` (m,) a
    pulse, and log likelihood ratios (m, r) of the known shape and of two free harmonics; ``along``
    and ``power`` (m, r, phases) as in `Search`. ``steady`` (m,) is the log likelihood ratio of
    `SHAPE_HARMONICS` of any size, at the rate where they explain the hold best."""

    noises: list[Noise]
    without: Array
    steady: Array
    shaped: Array
    free: Array
    along: Array
    power: Array


def _single(gain: Array, columns: int, dof: int) -> Array:
    """Chance at each rate of a log likelihood ratio ``gain`` (r,): F test of ``columns``."""
    dof = max(dof, 1)
    ratio = np.expm1(2 * gain / (dof + columns)) * dof / columns
    return np.asarray(fdtrc(columns, dof, ratio))


@dataclass(frozen=True)
class _Rests:
    """What each noise (m,) makes of a hold: nuisance ``q`` (m, n, k), signal ``y`` (m, n) beside
    it, and the restricted log likelihood ``without`` (m,) a pulse (Patterson & Thompson 1971)."""

    q: Array
    y: Array
    without: Array

    def of(self, chosen: Ints) -> "_Rests":
        """Those of some noises."""
        return _Rests(self.q[chosen], self.y[chosen], self.without[chosen])


def _looks(hold: Hold, design: Design, null: Fit, rates: Array, phases: int) -> Looks:
    """The hold at each rate in each noise that counts, its decays those of the null fit. The known
    shape is tried at so many ``phases``, or not at all."""
    n = len(hold.time_s)
    step = hold.span_s / max(n - 1, 1)
    nuisance = np.hstack([design.drift, design.decays[:, null.decays]])
    dof = n - nuisance.shape[1]
    even = np.arange(n) * step + hold.time_s[0]
    is_even = np.abs(hold.time_s - even).max() <= EVEN_BINS * step
    scale = np.ones(n) if is_even else np.sqrt(hold.weight)
    start_s = round(float(hold.time_s[0]), 4)
    times_s = np.asarray(start_s + hold.step_s * np.arange(n)) if is_even else hold.time_s
    each = max(1, MOST_KEPT // (n * 2 * SHAPE_HARMONICS))  # rates
    parts = np.array_split(rates, -(-len(rates) // each))
    key = (n, hold.step_s, start_s, tuple(rates.tolist()))
    kept = is_even and len(parts) == 1

    def columns_of(part: Array) -> Array:
        if kept:
            return _even_columns(*key)
        return _columns(times_s, part) * scale[:, None, None]

    steady, most = np.empty((n, 0)), -1.0
    for part in parts:
        columns = columns_of(part)
        along = np.tensordot(null.residual_pa * scale, columns, 1)[:, [0, columns.shape[2] // 2]]
        size = np.linalg.norm(along, axis=1)
        if size.max() > most:
            steady, most = columns[:, int(np.argmax(size))].copy(), float(size.max())
    members = family(hold.step_s, hold.averaged_s)
    all_columns = np.hstack([nuisance * scale[:, None], steady])
    rests, with_steady, steady_gain = _rests(
        hold.signal_pa * scale, all_columns, nuisance.shape[1], members, dof
    )
    count = SHAPE_HARMONICS if n >= SHORT else 1
    finest = FINEST * (n - 1) / max(hold.span_s, 1e-9)
    seen = rates[:, None] * np.arange(1, count + 1) <= finest
    ahead = np.maximum(rests.without - rests.without.max(), with_steady - with_steady.max())
    ahead[0] = 0.0  # white noise counts always
    counted = np.flatnonzero(ahead >= -FAR_BEHIND)
    chosen, by_part = rests.of(counted), []
    for part, visible in zip(parts, np.array_split(seen, len(parts)), strict=True):
        columns = columns_of(part)
        white = (
            _even_white(*key, members[i]) if kept else _whitened(columns, members[i])
            for i in counted
        )
        by_part.append(_ratios(chosen, white, visible, _shapes(visible, phases), dof))
    return Looks(
        [members[i] for i in counted], chosen.without, steady_gain[counted],
        *(np.concatenate(each, axis=1) for each in zip(*by_part, strict=True)),
    )  # fmt: skip


def _columns(time_s: Array, rates: Array) -> Array:
    """Harmonics (n, r, 2 count) of each rate."""
    return harmonics(time_s, rates, SHAPE_HARMONICS if len(time_s) >= SHORT else 1)


@lru_cache(maxsize=4)
def _even_columns(n: int, step_s: float, start_s: float, rates: tuple[float, ...]) -> Array:
    time_s = np.asarray(start_s + step_s * np.arange(n), dtype=float)
    return _columns(time_s, np.array(rates))


@dataclass(frozen=True)
class _Whitened:
    """Whitened harmonics, side by side for all rates (n, r * 2 count), and at each rate their
    products with each other (r, 2 count, 2 count)."""

    columns: Array
    gram: Array


def _whitened(columns: Array, noise: Noise) -> _Whitened:
    white = noise.whiten(columns)
    each = np.moveaxis(white, 0, 1)
    return _Whitened(
        np.ascontiguousarray(white.reshape(len(white), -1)), np.swapaxes(each, 1, 2) @ each
    )


@lru_cache(maxsize=48)
def _even_white(
    n: int, step_s: float, start_s: float, rates: tuple[float, ...], noise: Noise
) -> _Whitened:
    """The same for all holds of a scan."""
    return _whitened(_even_columns(n, step_s, start_s, rates), noise)


def _rests(
    signal: Array, columns: Array, nuisance: int, noises: Sequence[Noise], dof: int
) -> tuple[_Rests, Array, Array]:
    """Beside the first ``nuisance`` of ``columns`` (n, k), what is ``without`` beside all, and the
    log likelihood ratio of the others."""
    both = np.column_stack([columns, signal])
    white = np.stack([noise.whiten(both) for noise in noises])
    q, r = np.linalg.qr(white[..., :-1])
    y = white[..., -1]
    along = np.swapaxes(q, 1, 2) @ y[..., None]
    size = np.log(np.maximum(np.abs(np.diagonal(r, axis1=1, axis2=2)), 1e-300))

    def rest_of(k: int) -> _Rests:
        residual = y - (q[..., :k] @ along[:, :k])[..., 0]
        power = np.maximum((residual**2).sum(axis=1), 1e-300)
        return _Rests(q[..., :k], residual, -0.5 * dof * np.log(power) - size[:, :k].sum(axis=1))

    null, full = rest_of(nuisance), rest_of(columns.shape[1])
    power = [np.maximum((rest.y**2).sum(axis=1), 1e-300) for rest in (null, full)]
    return null, full.without, 0.5 * dof * np.log(power[0] / power[1])


def _shapes(seen: Bools, phases: int) -> Array:
    """The known shape [mmHg] in harmonics, at each rate and phase (r, phases, 2 count).

    ``seen`` (r, count): harmonics that the samples can tell from noise near their Nyquist rate.
    """
    count = seen.shape[1]
    order = np.arange(1, count + 1)
    turn = np.linspace(0, 2 * np.pi, phases, endpoint=False)[:, None]
    turned = PHASES_RAD[:count] + order * turn
    size = AMPLITUDES_MMHG[:count] * seen[:, None, :]
    return np.concatenate([size * np.cos(turned), -size * np.sin(turned)], axis=2)


def _ratios(
    rests: _Rests, white: Iterable[_Whitened], seen: Bools, shapes: Array, dof: int
) -> tuple[Array, Array, Array, Array]:
    """``shaped``, ``free``, ``along`` and ``power`` of `Looks` at some rates. The second free
    harmonic counts only where it is no larger than a pulse's."""
    products, grams = [], []
    basis = np.concatenate([rests.q, rests.y[..., None]], axis=2)
    for each, whitened in zip(basis, white, strict=True):  # one by one: a table may be large
        product = each.T @ whitened.columns
        products.append(product.reshape(len(product), *whitened.gram.shape[:2]))
        grams.append(whitened.gram)
    product = np.stack(products)
    basis, right = np.moveaxis(product[:, :-1], 1, 3), product[:, -1]  # (m, r, count, k), (…count)
    gram = np.stack(grams) - basis @ np.swapaxes(basis, 2, 3)
    rss = np.maximum((rests.y**2).sum(axis=1), 1e-300)[:, None]

    def ratio(drop: Array) -> Array:
        return np.asarray(-0.5 * dof * np.log(np.clip(1 - drop / rss, 1e-12, 1.0)))

    along = (shapes @ right[..., None])[..., 0]
    power = ((shapes @ gram) * shapes).sum(axis=3)
    drop = (np.maximum(along, 0.0) ** 2 / np.maximum(power, 1e-300)).max(axis=2, initial=0.0)
    size, variance = SWING_MMHG, rss[..., None] / max(dof, 1)
    return (ratio(drop), ratio(_as_harmonics(right, gram, seen)),
            along / (size * variance), power / (size**2 * variance))  # fmt: skip


def _as_harmonics(right: Array, gram: Array, seen: Bools) -> Array:
    """What the first one or two harmonics explain (m, r)."""
    count = seen.shape[1]
    _, by_first = _explained(right, gram, [0, count])
    if count == 1:
        return by_first
    a, by_both = _explained(right, gram, [0, 1, count, count + 1])
    size = np.hypot(a[..., :2], a[..., 2:])
    pulse_like = seen[:, 1] & (size[..., 1] <= MOST_SECOND * size[..., 0])
    return np.asarray(np.where(pulse_like, by_both, by_first))


def _explained(right: Array, gram: Array, chosen: list[int]) -> tuple[Array, Array]:
    """Coefficients (m, r, k) of least squares on the ``chosen`` columns, and what they explain."""
    b, g = right[..., chosen], gram[..., chosen, :][..., chosen]
    ridge = 1e-9 * np.trace(g, axis1=-2, axis2=-1)[..., None, None] * np.eye(len(chosen))
    solved = np.linalg.solve(g + ridge, b[..., None])[..., 0]
    return solved, (b * solved).sum(axis=-1)
