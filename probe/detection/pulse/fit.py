"""One joint fit of a hold: relaxation, drift and a periodic pulse, in white or coloured noise.

Relaxation is a sum of exponentials with weights >= 0 over a grid of times: any completely monotone
decay, and nothing that could oscillate. So no filter is needed, though the fastest relaxation and
the pulse share a band. The noise's level is unknown, its spectrum is one of a family's.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import lsq_linear, nnls

from drivers.core.arrays import Array, Ints
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import WHITE, Noise

DECAYS = 16


@dataclass(frozen=True)
class Design:
    """Columns over the hold's samples: ``drift`` (n, 2), ``decays`` (n, d) with weights >= 0."""

    time_s: Array
    drift: Array
    decays: Array


@dataclass(frozen=True)
class Fit:
    """``coefficients`` of the free columns; ``rest_pa`` (n,) is all but the pulse and
    ``rest_mean_sd_pa`` the doubt of its mean; ``noise_pa`` is the innovation's standard deviation,
    ``dof`` what is left to judge by, ``decays`` which decays have weight.
    """

    coefficients: Array
    rest_pa: Array
    rest_mean_sd_pa: float
    residual_pa: Array
    rss: float
    dof: int
    noise_pa: float
    noise: Noise
    decays: Ints

    @property
    def lost(self) -> int:
        """Samples' worth of freedom that the fit has used up."""
        return len(self.residual_pa) - self.dof


@lru_cache(maxsize=64)
def design_of(hold: Hold) -> Design:
    """Drift and decays for a hold; kept for those of a scan."""
    t = hold.time_s
    span = max(hold.span_s, 1e-9)
    step = span / max(len(t) - 1, 1)
    taus = np.geomspace(max(2 * step, 0.03), 3 * span, DECAYS)
    drift = np.column_stack([np.ones_like(t), (t - t.mean()) / span])
    return Design(t, drift, np.exp(-(t[:, None] - t[0]) / taus))


def harmonics(time_s: Array, rate_hz: float | Array, count: int) -> Array:
    """(..., 2 count): cosines and sines of a rate's multiples at times (...); of rates (r,),
    (..., r, 2 count)."""
    first = np.exp(2j * np.pi * np.multiply.outer(time_s, rate_hz))
    found, turned = np.empty((*first.shape, 2 * count)), first
    for k in range(count):
        found[..., k], found[..., count + k] = turned.real, turned.imag
        turned = turned * first
    return found


def fit(
    hold: Hold, design: Design, pulse: Array, noise: Noise = WHITE, ridge: Array | None = None
) -> Fit:
    """Least squares of the whole hold with ``pulse`` columns (n, k), k = 0 for none.

    ``ridge`` (k,): noise over the standard deviation that a coefficient has beforehand; its share
    in the sum of squares counts in ``rss``.
    """
    free = np.hstack([design.drift, pulse])
    k, scale = free.shape[1], np.sqrt(hold.weight)
    white = noise.whiten(scale_rows(np.column_stack([free, design.decays, hold.signal_pa]), scale))
    if ridge is not None:
        held = np.zeros((len(ridge), white.shape[1]))
        held[:, design.drift.shape[1] : k] = np.diag(ridge)
        white = np.vstack([white, held])
    r = np.asarray(np.linalg.qr(white, mode="r"))
    free_y, free_decays, beside_decays = r[:k, -1], r[:k, k:-1], r[k:, k:-1]
    weight = _not_negative(beside_decays, r[k:, -1])
    left = r[k:, -1] - beside_decays @ weight
    inverse = np.linalg.inv(r[:k, :k])
    coefficients = inverse @ (free_y - free_decays @ weight)
    used, rss = np.flatnonzero(weight > 0), float(left @ left)
    information = _information(inverse, inverse @ free_decays[:, used], beside_decays[:, used])
    held_back = 0.0 if ridge is None else float(ridge**2 @ np.diag(information)[2:k])
    penalty = 0.0 if ridge is None else float(((ridge * coefficients[2:]) ** 2).sum())
    n = len(hold.time_s)
    dof = max(round(n - k + held_back - len(used)), 1)
    variance = max(rss - penalty, 0.0) / dof
    mean = np.concatenate([free.mean(axis=0), design.decays[:, used].mean(axis=0)])
    mean[2:k] = 0.0
    mean_sd = np.sqrt(max(mean @ information @ mean * variance, 0.0))
    rest = design.drift @ coefficients[:2] + design.decays @ weight
    plain = hold.signal_pa - rest - pulse @ coefficients[2:]
    return Fit(
        coefficients, rest, float(mean_sd), plain, rss, dof, float(np.sqrt(variance)), noise, used,
    )  # fmt: skip


def _information(inverse: Array, taken: Array, left: Array) -> Array:
    """Inverse of the normal matrix of free columns, of which ``inverse`` is their triangle's, and
    decays: ``taken`` of the free ones, and what is ``left`` (n, d) of them beside those."""
    k, gram = len(inverse), left.T @ left
    whole = np.empty((k + len(gram), k + len(gram)))
    try:
        whole[k:, k:] = np.linalg.inv(gram)
    except np.linalg.LinAlgError:  # two decays that are one in these samples
        whole[k:, k:] = np.linalg.pinv(gram)
    whole[:k, k:] = -taken @ whole[k:, k:]
    whole[k:, :k] = whole[:k, k:].T
    whole[:k, :k] = inverse @ inverse.T - whole[:k, k:] @ taken.T
    return whole


def _not_negative(columns: Array, y: Array) -> Array:
    """Least squares with coefficients of 0 or more."""
    try:
        weight, _ = nnls(columns, y)
    except RuntimeError:  # columns nearly alike, and next to no noise: it went round in circles
        weight = lsq_linear(columns, y, (0.0, np.inf), method="bvls").x
    return np.asarray(weight)


def scale_rows(columns: Array, scale: Array) -> Array:
    return np.asarray(columns * (scale if columns.ndim == 1 else scale[:, None]))
