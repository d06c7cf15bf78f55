"""A hold's pulse: whether there is one, at what rate, and how large."""

from dataclasses import dataclass

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.beat_train import beat_train
from probe.detection.pulse.causes import chance_without_pulse, coarse_of
from probe.detection.pulse.fit import Fit, design_of, fit, harmonics
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import WHITE, Noise, likeliest
from probe.detection.pulse.possible_rates import RATE_VARIABILITY, USUAL_SPREAD
from probe.detection.pulse.search import FINEST, SHARE, TESTED_HARMONICS, Prior, Search, search
from probe.detection.pulse.size import Rates, Sizes, averaged, sizes_at, together

SHARES = np.array([0.35, 0.20, 0.11, 0.064, 0.055, 0.038, 0.025, 0.02, 0.015, 0.012])
"""Harmonics that describe one: the brachial wave's over its swing from trough to crest."""
MISFIT = 0.008
"""How far a beat strays from ten harmonics at one rate, over the largest pulse there may be."""
MAX_CLEAR_CHANCE, MAX_TRAIN_CHANCE = 1e-6, 0.4
"""Chances of a steady pulse between which a hold is also looked at as a train of beats. Of 60 holds
of fibrillation that only the train finds, the steady search gives none more than the second."""
SHORTEST_TRAIN_S = 2.0
"""Three quick beats, two slow ones: less is no train."""
SWING_OVER_RESIDUAL = 3.0
"""How much larger a pulse may be than what a fit of relaxation and drift leaves of it."""


@dataclass(frozen=True)
class Scale:
    """How large a pulse may be, trough to crest, and the noise of a sample."""

    swing_pa: float
    noise_pa: float


@dataclass(frozen=True)
class Clearest:
    """What beats most clearly in a hold, whether or not it is a pulse: ``p_value`` is the chance of
    one at least as clear in a hold without any, at any rate.

    ``search`` is None where a reference gave the beats: then ``beating_s`` (n,) counts time in
    them, whose lengths have the standard deviation ``variability`` over the mean. ``noise`` and
    ``scale`` are what the wave leaves at its own rate.
    """

    rate_hz: float
    p_value: float
    noise: Noise
    scale: Scale
    search: Search | None
    beating_s: Array | None = None
    variability: float = RATE_VARIABILITY


@dataclass(frozen=True)
class Wave:
    """A wave fitted at ``rate_hz``, of at most ``scale`` and of about ``swing_pa``."""

    rate_hz: float
    noise: Noise
    scale: Scale
    swing_pa: float
    fit: Fit
    beating_s: Array | None


@dataclass(frozen=True)
class Pulse:
    """A station's pulse at ``rate_hz``: ``size_pa`` from trough to crest as fitted, its standard
    deviation, and ``p_value`` and ``search`` as of `Clearest`.

    ``baseline_pa`` is the mean over the hold of all but the pulse, with its standard deviation.
    ``sizes`` are what ``size_pa`` is the mean of. ``variability`` is the standard deviation of a
    beat's length over the mean.
    """

    rate_hz: float
    size_pa: float
    size_sd_pa: float
    p_value: float
    baseline_pa: float
    baseline_sd_pa: float
    noise_pa: float
    fit: Fit
    search: Search | None
    sizes: Sizes
    variability: float = RATE_VARIABILITY


def beside(
    hold: Hold, rate_hz: float, scale: Scale, beating_s: Array | None = None
) -> tuple[Noise, Scale]:
    """The noise's spectrum and level beside a whole wave at a rate.

    ``beating_s`` (n,) where time is counted in another way for the harmonics.
    """
    first, _ = described(hold, rate_hz, WHITE, scale, beating_s)
    noise_pa = max(first.noise_pa, MISFIT * scale.swing_pa)
    return likeliest(first.residual_pa, hold.step_s, hold.averaged_s), Scale(
        scale.swing_pa, noise_pa
    )


def wave_at(
    hold: Hold, rate_hz: float, noise: Noise, scale: Scale, beating_s: Array | None = None
) -> Wave:
    """The wave at a known rate.

    Harmonics are shrunk towards the sizes that arterial waves have: a hold shorter than a beat, or
    a slow one in relaxing tissue, would otherwise be explained by huge waves that cancel.
    """
    fitted, columns = described(hold, rate_hz, noise, scale, beating_s)
    # with harmonics as large as its own size has them, noise adds nothing from trough to crest
    swing_pa = min(scale.swing_pa, float(np.ptp(columns @ fitted.coefficients[2:])))
    fitted, _ = described(hold, rate_hz, noise, Scale(swing_pa, scale.noise_pa), beating_s)
    return Wave(rate_hz, noise, scale, swing_pa, fitted, beating_s)


def pulse_of(hold: Hold, own: Clearest, wave: Wave, shared: Rates | None = None) -> Pulse:
    """How large a wave is, and how surely.

    ``shared`` are the rates that the scan leaves, all that are tried where it shows none.
    """
    fitted, rates = wave.fit, shared or Rates(np.array([wave.rate_hz]), own.variability)
    sizes = sizes_of(hold, wave, rates, None if shared else USUAL_SPREAD)
    size_pa, size_sd_pa = averaged(sizes, *together([sizes]))
    noise_pa = _noise_pa(wave)
    unmodelled = noise_pa / max(fitted.noise_pa, 1e-12)
    return Pulse(
        wave.rate_hz, size_pa, size_sd_pa, own.p_value,
        float(fitted.rest_pa.mean()), unmodelled * fitted.rest_mean_sd_pa, fitted.noise_pa,
        fitted, own.search, sizes, rates.variability,
    )  # fmt: skip


def sizes_of(hold: Hold, wave: Wave, rates: Rates, spread: float | None = None) -> Sizes:
    """Sizes of a pulse like ``wave`` at each of ``rates``, which have a standard deviation of
    ``spread`` over them: that of the hold's beats by default."""
    parts = wave.fit.coefficients[2:].reshape(2, -1)
    count = parts.shape[1]
    seen = np.array([harmonics_seen(hold, float(hz), count) for hz in rates.hz])
    share = np.where(np.arange(count) < seen[:, None], SHARES[:count], 0.0)
    prior_pa = share * max(wave.swing_pa, 1e-12)
    late = None
    if wave.beating_s is None:
        usual = rates.variability / np.sqrt(np.maximum(hold.span_s * rates.hz, 1.0))
        late = parts, np.full(len(rates.hz), spread) if spread else usual
    noise_pa = _noise_pa(wave)
    sizes = sizes_at(hold, wave.noise, noise_pa, prior_pa, rates.hz, late, wave.beating_s)
    return Sizes(tuple(rates.hz.tolist()), *sizes)


def _noise_pa(wave: Wave) -> float:
    return max(wave.scale.noise_pa, wave.fit.noise_pa, 1e-12)


def described(
    hold: Hold, rate_hz: float, noise: Noise, scale: Scale, beating_s: Array | None = None
) -> tuple[Fit, Array]:
    """The fit of a wave at a rate, and the columns (n, 2 harmonics) of those that are seen."""
    count = harmonics_seen(hold, rate_hz, len(SHARES))
    columns = harmonics(hold.time_s if beating_s is None else beating_s, rate_hz, count)
    ridge = scale.noise_pa / (np.tile(SHARES[:count], 2) * max(scale.swing_pa, 1e-12))
    return fit(hold, design_of(hold), columns, noise, ridge), columns


def harmonics_seen(hold: Hold, rate_hz: float, most: int) -> int:
    """Harmonics of a rate, of up to ``most``, that the hold's samples can separate from noise."""
    finest = FINEST * len(hold.time_s) / max(hold.span_s, 1e-9)
    return int(np.clip(finest // rate_hz, 1, most))


def scale_of(null: Fit, known: Fit) -> Scale:
    """From the fits without a pulse and with its first harmonics.

    What relaxation and drift cannot explain is at least a third of the pulse.
    """
    residual_pa = null.residual_pa
    return Scale(
        float(SWING_OVER_RESIDUAL * np.ptp(np.percentile(residual_pa, [2, 98]))), known.noise_pa
    )


def find_pulse(hold: Hold, prior: Prior | None = None) -> Clearest:
    """The clearest pulse of a hold, whether or not there is one.

    It passes at one rate or as a train of beats of any lengths, which has its own `SHARE` of the
    chance.
    """
    clearest, null = search(hold, prior)
    columns = harmonics(hold.time_s, clearest.rate_hz, TESTED_HARMONICS)
    known = fit(hold, design_of(hold), columns, clearest.noise)
    p_value = clearest.p_value
    if MAX_CLEAR_CHANCE < p_value < MAX_TRAIN_CHANCE and hold.span_s >= SHORTEST_TRAIN_S:
        coarse = coarse_of(hold, null)
        p_value = min(p_value, chance_without_pulse(coarse, beat_train(coarse)) / SHARE["train"])
    noise, scale = beside(hold, clearest.rate_hz, scale_of(null, known))
    return Clearest(clearest.rate_hz, p_value, noise, scale, clearest)
