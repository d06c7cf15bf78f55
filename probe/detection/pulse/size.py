"""The size of a pulse and its interval, in tissue that relaxes by an unknown amount.

In a hold of one beat a slow decay looks much like the pulse, so that the interval depends on what
is believed of relaxation. A fit that switches decays on and off would be sure where it has none and
ignorant where noise made one active. Here each decay's weight is normal about zero, and their
standard deviation is one share of the force, unknown from what no sensor sees to all of it; sizes
are averaged over it by the evidence (Hoeting et al. 1999), which all presses of a scan add to.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.fit import design_of, harmonics, scale_rows
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import Noise
from probe.detection.pulse.possible_rates import RATE_VARIABILITY

RELAXING = np.geomspace(1e-6, 1.0, 13)
"""Standard deviation of a decay's weight over the force, two to a decade: the weights of `fit` on
30 holds of real tissue have 0.007 to 0.75, solved tissue has none."""
PHASES = np.linspace(0.0, 1.0, 128, endpoint=False)
"""Of a beat, where its crest and trough are looked for."""


@dataclass(frozen=True)
class Sizes:
    """Trough to crest and its standard deviation for each of `RELAXING` (r,), and the log evidence
    of each."""

    size_pa: Array
    sd_pa: Array
    evidence: Array


@dataclass(frozen=True)
class Rates:
    """Rates (f,) that a scan leaves to its heart, the likeliest first, and their posterior
    probabilities (f,); the standard deviation of a beat's length over the mean one."""

    hz: Array
    share: Array
    variability: float = RATE_VARIABILITY


def sizes_at(
    hold: Hold, noise: Noise, noise_pa: float, prior_pa: Array, rate_hz: float, late: Array | None,
    beating_s: Array | None = None,
) -> Sizes:  # fmt: skip
    """Sizes of a pulse at ``rate_hz`` in ``noise`` of innovations ``noise_pa``.

    ``prior_pa`` (k,) are standard deviations of the harmonics' amplitudes beforehand. ``late`` (n,)
    is what a rate one standard deviation higher adds to the signal, None where the beats are known.
    ``beating_s`` (n,) where time is counted in another way for the harmonics.
    """
    weight = np.sqrt(hold.weight)

    def white(columns: Array) -> Array:
        return noise.whiten(scale_rows(columns, weight)) / noise_pa

    # level and drift are projected out
    design, count = design_of(hold), len(prior_pa)
    q, _ = np.linalg.qr(white(design.drift))
    time_s = hold.time_s if beating_s is None else beating_s
    kept = np.tile(np.sinc(rate_hz * np.arange(1, count + 1) * hold.averaged_s), 2)
    wave = harmonics(time_s, rate_hz, count) * np.tile(prior_pa, 2) * kept
    if late is not None:
        wave = np.column_stack([wave, late])
    y, decays, wave = (v - q @ (q.T @ v) for v in map(white, (hold.signal_pa, design.decays, wave)))

    # decays with weights N(0, s^2) lessen the precision along their singular vectors
    u, singular, _ = np.linalg.svd(decays, full_matrices=False)
    grown = 1 + np.outer(RELAXING * abs(float(hold.signal_pa.mean())), singular) ** 2
    lost = 1 - 1 / grown
    uy, uw = u.T @ y, u.T @ wave
    rss = y @ y - lost @ uy**2
    gram = wave.T @ wave - np.einsum("rd,di,dj->rij", lost, uw, uw)
    right = wave.T @ y - np.einsum("rd,di,d->ri", lost, uw, uy)

    # the wave's columns have unit variance beforehand
    precision = gram + np.eye(gram.shape[1])
    covariance = np.linalg.inv(precision)
    found = np.einsum("rij,rj->ri", covariance, right)
    explained = np.einsum("ri,ri->r", found, right)
    volume = np.log(grown).sum(axis=1) + np.linalg.slogdet(precision)[1]
    evidence = -0.5 * (rss - explained + volume)

    beat = np.zeros((len(PHASES), gram.shape[1]))
    beat[:, : 2 * count] = harmonics(PHASES, 1.0, count) * np.tile(prior_pa, 2)
    shape = found @ beat.T
    slope = beat[shape.argmax(axis=1)] - beat[shape.argmin(axis=1)]
    variance = np.einsum("ri,rij,rj->r", slope, covariance, slope)
    return Sizes(np.ptp(shape, axis=1), np.sqrt(np.maximum(variance, 0.0)), evidence)


def mixed(each: Sequence[Sizes], share: Array) -> Sizes:
    """One out of sizes at several rates that have probabilities ``share`` (f,)."""
    size, sd, evidence = (np.array(v) for v in zip(
        *((one.size_pa, one.sd_pa, one.evidence) for one in each), strict=True))  # fmt: skip
    mean = share @ size
    return Sizes(mean, np.sqrt(share @ (sd**2 + (size - mean) ** 2)), share @ evidence)


def averaged(sizes: Sizes, evidence: Array) -> tuple[float, float]:
    """Mean and standard deviation of the size over `RELAXING`, given the log ``evidence`` (r,)."""
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    mean = float(share @ sizes.size_pa)
    return mean, float(np.sqrt(share @ (sizes.sd_pa**2 + (sizes.size_pa - mean) ** 2)))


def together(all_sizes: Sequence[Sizes]) -> Array:
    """Log evidence (r,) of all presses: what tissue relaxes by, over the force, it does
    everywhere."""
    return np.asarray(np.sum([one.evidence for one in all_sizes], axis=0))
