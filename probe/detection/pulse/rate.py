"""The rate of one heart in several holds."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp

from drivers.core.arrays import Array
from probe.detection.pulse.estimate import SHARES, Wave, harmonics_seen, sizes_of
from probe.detection.pulse.fit import design_of, harmonics, scale_rows
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import Noise
from probe.detection.pulse.possible_rates import FASTEST_HZ, SLOWEST_HZ, rates_hz, unusual
from probe.detection.pulse.search import TESTED_HARMONICS, Search
from probe.detection.pulse.size import Rates, together

SMOOTH = 0.75
"""Cycles that the last harmonic looked at may gain in a hold from one rate tried to the next: of
more harmonics the likelihood is too narrow a peak."""
PLAUSIBLE = 0.02
"""Of the likeliest rate's likelihood: less changes no interval."""
CANDIDATES, EXACT_HZ = 4, 1e-3
"""Rates that each way of searching proposes, and how exactly the best of them is wanted."""
SHORT_EXACT_HZ = 0.01
"""The same in a short hold: a heart's own variability, 5 % of 1 Hz over a beat, forgives more."""


def shared_rate(clear: list[tuple[Hold, Wave, Search | None]]) -> Rates:
    """The rate that explains the clearest pulses best, given what rates hearts have; after it
    all others that were tried and are at least `PLAUSIBLE` times as likely."""
    span_s = max(hold.span_s for hold, *_ in clear)
    rates = rates_hz(span_s)
    if is_short(span_s):
        return _of_short(clear, rates)
    holds = [_whitened(hold, wave) for hold, wave, _ in clear]

    def unlikely(rate_hz: float, most: int) -> float:
        misfit = sum(_misfit(one, rate_hz, most) for one in holds)
        return float(unusual(rate_hz)) + misfit

    reach, smooth = float(rates[1] - rates[0]), _smooth(span_s)
    searches = [one for *_, one in clear if one is not None]
    likely = [
        np.sum([np.interp(rates, s.rates_hz, seen) for s, seen in each], axis=0) - unusual(rates)
        for each in ([(s, s.gain) for s in searches], [(s, s.clear / 2) for s in searches])
    ]
    tried = {int(k) for one in likely for k in np.argsort(one)[-CANDIDATES:]}
    unlike = {float(rates[k]): unlikely(float(rates[k]), smooth) for k in tried}
    rate = min(unlike, key=lambda one: unlike[one])
    for most, share in ((smooth, 1.0), (len(SHARES), 0.25)):
        bounds = max(rate - share * reach, SLOWEST_HZ), min(rate + share * reach, FASTEST_HZ)
        fitted = minimize_scalar(unlikely, bounds=bounds, args=(most,), method="bounded",
                                options={"xatol": EXACT_HZ})  # fmt: skip
        rate = float(fitted.x)
    best = unlikely(rate, smooth)
    rivals = {one: float(np.exp(min(best - v, 0.0))) for one, v in unlike.items()
              if abs(one - rate) > reach / 2}  # fmt: skip
    rivals = {one: weight for one, weight in rivals.items() if weight >= PLAUSIBLE}
    return Rates(np.array([rate, *rivals]))


def is_short(span_s: float) -> bool:
    """Whether shape and relaxation show more of a heart's rate than the search's harmonics do: in
    about two seconds, where the likelihood is a smooth function of more of them."""
    return _smooth(span_s) > TESTED_HARMONICS + 1


def _smooth(span_s: float) -> int:
    """How many harmonics may be looked at from one rate tried to the next."""
    first, second, *_ = rates_hz(span_s)
    return int(
        np.clip(round(SMOOTH / ((second - first) * span_s)), TESTED_HARMONICS + 1, len(SHARES))
    )


def _of_short(clear: list[tuple[Hold, Wave, Search | None]], rates: Array) -> Rates:
    """The plausible of ``rates`` (f,) and of the peaks between them, whatever tissue relaxes by: in
    a hold of about a beat relaxation makes one rate look like another."""

    def likely(hz: Array) -> Array:
        sizes = [sizes_of(hold, wave, Rates(hz)) for hold, wave, _ in clear]
        return np.asarray(logsumexp(together(sizes)[0], axis=1))

    chance, reach = likely(rates), float(rates[1] - rates[0])
    padded = np.pad(chance, 1, constant_values=-np.inf)
    peaks = np.flatnonzero((chance >= padded[:-2]) & (chance >= padded[2:]))
    peaks = peaks[np.argsort(chance[peaks])[-CANDIDATES:]]
    between = rates[peaks, None] + np.arange(SHORT_EXACT_HZ - reach, reach, SHORT_EXACT_HZ)
    between = np.clip(between, SLOWEST_HZ, FASTEST_HZ)
    likelihood = likely(between.ravel()).reshape(between.shape)
    better = likelihood.max(axis=1) > chance[peaks]
    rates[peaks[better]] = between[np.arange(len(peaks)), likelihood.argmax(axis=1)][better]
    chance[peaks[better]] = likelihood.max(axis=1)[better]
    order = np.argsort(-chance)
    return Rates(rates[order[chance[order] >= chance.max() + np.log(PLAUSIBLE)]])


@dataclass(frozen=True)
class _Whitened:
    """A hold in the noise that its own pulse left: signal (n,) and a basis (n, k) of what
    relaxation and drift could take."""

    hold: Hold
    noise: Noise
    weight: Array
    signal: Array
    beside: Array
    noise_over_swing: float


def _whitened(hold: Hold, wave: Wave) -> _Whitened:
    design, weight = design_of(hold), np.sqrt(hold.weight)
    columns = np.hstack([design.drift, design.decays[:, wave.fit.decays]])
    noise, scale = wave.noise, wave.scale
    nuisance, _ = np.linalg.qr(noise.whiten(scale_rows(columns, weight)))
    signal = noise.whiten(hold.signal_pa * weight)
    signal = signal - nuisance @ (nuisance.T @ signal)
    return _Whitened(hold, noise, weight, signal, nuisance,
                     scale.noise_pa / max(scale.swing_pa, 1e-12))  # fmt: skip


def _misfit(white: _Whitened, rate_hz: float, most: int) -> float:
    """Minus the log likelihood of harmonics that are shrunk as `described` does, the noise's level
    unknown."""
    hold = white.hold
    count = harmonics_seen(hold, rate_hz, most)
    columns = scale_rows(harmonics(hold.time_s, rate_hz, count), white.weight)
    columns = white.noise.whiten(columns)
    columns = columns - white.beside @ (white.beside.T @ columns)
    right = columns.T @ white.signal
    ridge = white.noise_over_swing / np.tile(SHARES[:count], 2)
    size = np.linalg.solve(columns.T @ columns + np.diag(ridge**2), right)
    rss = float(white.signal @ white.signal - right @ size)
    return 0.5 * len(hold.time_s) * float(np.log(max(rss, 1e-300)))
