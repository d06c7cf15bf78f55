"""The size of a pulse and its interval, in tissue that relaxes by an unknown amount.

In a hold of one beat a slow decay looks much like the pulse, so that the interval depends on what
is believed of relaxation. A fit that switches decays on and off would be sure where it has none and
ignorant where noise made one active. Here each decay's weight is normal about zero, and their
standard deviation is one share of the force, unknown from what no sensor sees to all of it; sizes
are averaged over it by the evidence (Hoeting et al. 1999), which all presses of a scan add to.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import logsumexp

from drivers.core.arrays import Array
from probe.detection.pulse.fit import design_of, harmonics, scale_rows
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import Noise
from probe.detection.pulse.possible_rates import RATE_VARIABILITY, unusual

RELAXING = np.geomspace(1e-6, 1.0, 13)
"""Standard deviation of a decay's weight over the force, two to a decade: the weights of `fit` on
30 holds of real tissue have 0.007 to 0.75, solved tissue has none."""
PHASES = np.linspace(0.0, 1.0, 128, endpoint=False)
"""Of a beat, where its crest and trough are looked for."""


@dataclass(frozen=True)
class Rates:
    """Rates (f,) that a scan leaves to its heart, the likeliest first; the standard deviation of a
    beat's length over the mean one."""

    hz: Array
    variability: float = RATE_VARIABILITY


@dataclass(frozen=True)
class Sizes:
    """Trough to crest and its standard deviation at each rate and for each of `RELAXING` (f, r),
    and the log evidence of each."""

    rates_hz: tuple[float, ...]
    size_pa: Array
    sd_pa: Array
    evidence: Array


@dataclass(frozen=True)
class _Relaxing:
    """A hold in white noise of one: signal (n,) and orthonormal shapes of relaxation (n, d), both
    beside the ``level`` (n, 1), and for each of `RELAXING` what those lose of their weight (r, d)
    and the logarithm of the volume that they take (r,)."""

    level: Array
    signal: Array
    shapes: Array
    lost: Array
    volume: Array


@lru_cache(maxsize=64)
def _relaxing(hold: Hold, noise: Noise, noise_pa: float) -> _Relaxing:
    """Decays, and a drift over the hold, with weights N(0, s^2) lessen the precision along their
    singular vectors; the level is free."""
    design = design_of(hold)
    level, _ = np.linalg.qr(_white(hold, noise, noise_pa, design.drift[:, :1]))
    columns = np.column_stack([hold.signal_pa, design.drift[:, 1:], design.decays])
    columns = _white(hold, noise, noise_pa, columns)
    columns -= level @ (level.T @ columns)
    shapes, singular, _ = np.linalg.svd(columns[:, 1:], full_matrices=False)
    grown = 1 + np.outer(RELAXING * abs(float(hold.signal_pa.mean())), singular) ** 2
    return _Relaxing(level, columns[:, 0], shapes, 1 - 1 / grown, np.log(grown).sum(axis=1))


def _white(hold: Hold, noise: Noise, noise_pa: float, columns: Array) -> Array:
    return noise.whiten(scale_rows(columns, np.sqrt(hold.weight))) / noise_pa


def sizes_at(
    hold: Hold, noise: Noise, noise_pa: float, prior_pa: Array, rate_hz: float, late: Array | None,
    beating_s: Array | None = None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Size of a pulse at ``rate_hz``, its standard deviation and the log evidence, for each of
    `RELAXING` (r,), in ``noise`` of innovations ``noise_pa``.

    ``prior_pa`` (k,) are standard deviations of the harmonics' amplitudes beforehand. ``late`` (n,)
    is what a rate one standard deviation higher adds to the signal, None where the beats are known.
    ``beating_s`` (n,) where time is counted in another way for the harmonics.
    """
    one, count = _relaxing(hold, noise, noise_pa), len(prior_pa)
    time_s = hold.time_s if beating_s is None else beating_s
    kept = np.tile(np.sinc(rate_hz * np.arange(1, count + 1) * hold.averaged_s), 2)
    wave = harmonics(time_s, rate_hz, count) * (np.tile(prior_pa, 2) * kept)
    if late is not None:
        wave = np.column_stack([wave, late])
    wave = _white(hold, noise, noise_pa, wave)
    wave -= one.level @ (one.level.T @ wave)
    along, across = one.shapes.T @ one.signal, one.shapes.T @ wave
    rss = one.signal @ one.signal - one.lost @ along**2
    gram = wave.T @ wave - (across.T * one.lost[:, None, :]) @ across
    right = wave.T @ one.signal - (one.lost * along) @ across

    # the wave's columns have unit variance beforehand
    precision = gram + np.eye(gram.shape[1])
    covariance = np.linalg.inv(precision)
    found = np.squeeze(covariance @ right[:, :, None], axis=2)
    # the volume that a wave takes compares relaxations only: by it slow hearts would be likelier,
    # whose ten harmonics have fewer directions in a hold
    taken = np.linalg.slogdet(precision)[1]
    evidence = -0.5 * (rss - (found * right).sum(axis=1) + one.volume + taken - taken[0])

    beat = np.zeros((len(PHASES), gram.shape[1]))
    beat[:, : 2 * count] = harmonics(PHASES, 1.0, count) * np.tile(prior_pa, 2)
    shape = found @ beat.T
    slope = beat[shape.argmax(axis=1)] - beat[shape.argmin(axis=1)]
    variance = ((slope[:, None, :] @ covariance)[:, 0] * slope).sum(axis=1)
    return np.ptp(shape, axis=1), np.sqrt(np.maximum(variance, 0.0)), evidence


def averaged(sizes: Sizes, evidence: Array) -> tuple[float, float]:
    """Mean and standard deviation of the size, given the log ``evidence`` (f, r)."""
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    mean = float((share * sizes.size_pa).sum())
    return mean, float(np.sqrt((share * (sizes.sd_pa**2 + (sizes.size_pa - mean) ** 2)).sum()))


def together(all_sizes: Sequence[Sizes]) -> list[Array]:
    """Log evidence (f, r) for each by all presses: what tissue relaxes by, over the force, it does
    everywhere, and presses that are measured at the same rates have the same heart."""
    hearts = {one.rates_hz: -unusual(one.rates_hz)[:, None] for one in all_sizes}
    for one in all_sizes:
        hearts[one.rates_hz] = hearts[one.rates_hz] + one.evidence
    relaxing = {rates: logsumexp(seen, axis=0) for rates, seen in hearts.items()}
    whole = np.sum(list(relaxing.values()), axis=0)
    return [hearts[one.rates_hz] + whole - relaxing[one.rates_hz] for one in all_sizes]
