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
UNSEEN = 1e-9
"""Of what is known of a direction: if relaxation takes less, no digit that is shown changes."""
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
    grown = np.outer(RELAXING * abs(float(hold.signal_pa.mean())), singular) ** 2
    seen = grown[-1] > UNSEEN
    lost = grown[:, seen] / (1 + grown[:, seen])
    return _Relaxing(level, columns[:, 0], shapes[:, seen], lost, np.log1p(grown).sum(axis=1))


def _white(hold: Hold, noise: Noise, noise_pa: float, columns: Array) -> Array:
    return noise.whiten(scale_rows(columns, np.sqrt(hold.weight))) / noise_pa


def sizes_at(
    hold: Hold, noise: Noise, noise_pa: float, prior_pa: Array, rates_hz: Array,
    late: tuple[Array, Array] | None, beating_s: Array | None = None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Size of a pulse at each of ``rates_hz`` (f,), its standard deviation and the log evidence,
    for each of `RELAXING` (f, r), in ``noise`` of innovations ``noise_pa``.

    ``prior_pa`` (f, k) are standard deviations of the harmonics' amplitudes beforehand, 0 for those
    that are not seen. ``late``: cosines and sines of the wave (2, k) and the standard deviation of
    each rate (f,) over itself, None where the beats are known. ``beating_s`` (n,) where time is
    counted in another way for the harmonics.
    """
    relaxing, prior = _relaxing(hold, noise, noise_pa), np.tile(prior_pa, 2)
    columns = _columns(hold, prior, rates_hz, late, beating_s)
    white = _white(hold, noise, noise_pa, columns.reshape(len(columns), -1))
    white -= relaxing.level @ (relaxing.level.T @ white)
    wave = _posterior(relaxing, white.reshape(columns.shape))

    count = prior.shape[1]
    beat = harmonics(PHASES, 1.0, count // 2)
    shape = (wave.mean[..., :count] * prior[:, None]) @ beat.T
    slope = np.zeros_like(wave.mean)
    highest, lowest = beat[shape.argmax(axis=2)], beat[shape.argmin(axis=2)]
    slope[..., :count] = (highest - lowest) * prior[:, None]
    within = slope @ wave.down
    variance = ((slope @ wave.free) * slope).sum(axis=2)
    variance += (np.squeeze(within[..., None, :] @ wave.taking, axis=2) * within).sum(axis=2)
    return np.ptp(shape, axis=2), np.sqrt(np.maximum(variance, 0.0)), wave.evidence


def _columns(
    hold: Hold, prior: Array, rates_hz: Array, late: tuple[Array, Array] | None,
    beating_s: Array | None,
) -> Array:  # fmt: skip
    """What amplitudes of one standard deviation beforehand add to the signal (n, f, c): cosines,
    sines and, if there is a ``late``, a higher rate, to first order."""
    count = prior.shape[1] // 2
    order = np.arange(1, count + 1)
    waves = harmonics(hold.time_s if beating_s is None else beating_s, rates_hz, count)
    kept = np.tile(np.sinc(np.multiply.outer(rates_hz, order) * hold.averaged_s), 2)
    columns = waves * (prior * kept)
    if late is None:
        return columns
    (cosines, sines), off = late
    turned = np.concatenate([order * sines, -order * cosines]) * (prior > 0)
    t = hold.time_s - hold.time_s.mean()
    higher = np.multiply.outer(t, 2 * np.pi * rates_hz * off) * (waves * turned).sum(axis=2)
    return np.concatenate([columns, higher[..., None]], axis=2)


@dataclass(frozen=True)
class _Posterior:
    """Mean weights of a wave's columns (f, r, c) and the log evidence (f, r). The covariance is
    ``free`` (f, c, c) without relaxation, and ``down @ taking @ down.T``, (f, c, d) and
    (f, r, d, d), is what relaxation adds."""

    mean: Array
    evidence: Array
    free: Array
    down: Array
    taking: Array


def _posterior(relaxing: _Relaxing, white: Array) -> _Posterior:
    """Of columns (n, f, c) with weights N(0, 1), in tissue that relaxes by each of `RELAXING`.

    Relaxation is known in few directions, the wave in many: by Woodbury (1950) only a matrix of the
    former is inverted for each of both.
    """
    across = np.moveaxis(np.tensordot(relaxing.shapes, white, axes=(0, 0)), 0, 1)
    right = np.tensordot(relaxing.signal, white, axes=(0, 0))
    each = np.ascontiguousarray(np.moveaxis(white, 0, 1))
    precision = np.swapaxes(each, 1, 2) @ each + np.eye(white.shape[2])
    free = np.asarray(np.linalg.inv(precision), float)
    down = free @ np.swapaxes(across, 1, 2)

    loss, shared = np.sqrt(relaxing.lost), across @ down
    damped = np.eye(loss.shape[1]) - loss[:, :, None] * shared[:, None] * loss[:, None, :]
    taking = loss[:, :, None] * np.linalg.inv(damped) * loss[:, None, :]

    along = relaxing.shapes.T @ relaxing.signal
    lost = relaxing.lost * along
    pulled = right[:, None] @ down - lost @ shared
    weight = np.squeeze(taking @ pulled[..., None], axis=3) - lost
    mean = (free @ right[..., None])[:, None, :, 0] + weight @ np.swapaxes(down, 1, 2)

    rss = relaxing.signal @ relaxing.signal - lost @ along
    explained = (mean * (right[:, None] - lost @ across)).sum(axis=2)
    # the volume that a wave takes compares relaxations only: by it slow hearts would be likelier,
    # whose ten harmonics have fewer directions in a hold
    taken = np.linalg.slogdet(damped)[1]
    evidence = -0.5 * (rss - explained + relaxing.volume + taken)
    return _Posterior(mean, evidence, free, down, taking)


def averaged(sizes: Sizes, evidence: Array) -> tuple[float, float]:
    """Mean and standard deviation of the size, given the log ``evidence`` (f, r)."""
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    mean = float((share * sizes.size_pa).sum())
    return mean, float(np.sqrt((share * (sizes.sd_pa**2 + (sizes.size_pa - mean) ** 2)).sum()))


def together(all_sizes: Sequence[Sizes]) -> list[Array]:
    """Log evidence (f, r) for each by all presses: what tissue relaxes by, over the force, it does
    everywhere, and presses that are measured at the same rates have the same heart."""
    hearts = {sizes.rates_hz: -unusual(sizes.rates_hz)[:, None] for sizes in all_sizes}
    for sizes in all_sizes:
        hearts[sizes.rates_hz] = hearts[sizes.rates_hz] + sizes.evidence
    relaxing = {rates: logsumexp(seen, axis=0) for rates, seen in hearts.items()}
    of_all = np.sum(list(relaxing.values()), axis=0)
    return [hearts[sizes.rates_hz] + of_all - relaxing[sizes.rates_hz] for sizes in all_sizes]
