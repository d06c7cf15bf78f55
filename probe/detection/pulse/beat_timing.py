"""A heart's own unevenness within a hold: when each beat came, from the pulse itself.

A wave of one steady rate smears a pulse whose beats come early and late, and takes it for as little
as half of what it is. Where a pulse is clear, its beats are followed.
"""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.estimate import SHARES, Wave
from probe.detection.pulse.fit import harmonics
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.possible_rates import RATE_VARIABILITY
from probe.detection.pulse.search import FINEST

FOLLOWED = 5
"""Harmonics that are followed; finer ones only sharpen what these have placed."""
STRETCHES = np.linspace(-0.08, 0.08, 17)
"""How much faster this hold may beat than the rate that all share; tried with `SMOOTH` harmonics,
since of more the likelihood is too narrow a peak."""
SMOOTH = 2
ROUNDS = 5
SETTLED = 2e-3
"""Of a beat: what no longer matters."""
MAX_MOVE = 0.2
"""Of a beat: how far one round may move it."""


def own_beats_s(hold: Hold, wave: Wave) -> Array:
    """Time (n,) [s] counted in the hold's own beats, as if each took one period of ``wave``.

    Gauss-Newton on the wave and its timing at once. Beforehand the lengths of beats are normal
    about their own mean, or where ``wave`` counts in beats already about what they have there, with
    a standard deviation of `RATE_VARIABILITY` (so that timing is a random walk).
    """
    period = 1 / wave.rate_hz
    t = hold.time_s if wave.beating_s is None else wave.beating_s
    scale = np.sqrt(hold.weight)
    y = scale * (hold.signal_pa - wave.fit.rest_pa)
    since = hold.time_s - hold.time_s.mean()
    drift = scale[:, None] * np.column_stack([np.ones_like(t), since / hold.span_s])
    count = int(np.clip(FINEST * len(t) / hold.span_s // wave.rate_hz, 1, FOLLOWED))

    def beside_drift(time_s: Array, most: int) -> Array:
        """Columns (..., n, 2 + 2 most) of a drift and a wave's harmonics at times (..., n)."""
        waves = scale[:, None] * harmonics(time_s, wave.rate_hz, most)
        return np.concatenate([np.broadcast_to(drift, (*waves.shape[:-1], 2)), waves], axis=-1)

    stretched = t + STRETCHES[:, None] * (t - t.mean())
    q, _ = np.linalg.qr(beside_drift(stretched, min(SMOOTH, count)))
    explained = ((y @ q) ** 2).sum(axis=1)

    knots = np.linspace(t[0], t[-1], max(3, 1 + round(float(np.ptp(t)) / period)))
    hats = np.array([np.interp(t, knots, one) for one in np.eye(len(knots))]).T
    steps = np.diff(np.eye(len(knots)), axis=0)
    walk = (steps - steps.mean(axis=0)) / (
        RATE_VARIABILITY * np.sqrt(period * (knots[1] - knots[0]))
    )
    late = STRETCHES[int(np.argmax(explained))] * (knots - t.mean())
    noise = max(wave.fit.noise_pa, 1e-12)
    order, first, last = np.arange(1, count + 1), 2, 2 + 2 * count
    prior = np.diag(noise / (np.tile(SHARES[:count], 2) * max(np.ptp(y), 1e-12)))
    coefficients = np.zeros(2 * count)
    for _ in range(ROUNDS):
        base = beside_drift(t + hats @ late, count)
        shrunk = np.vstack([base, np.hstack([np.zeros((2 * count, 2)), prior])])
        found = np.linalg.lstsq(shrunk, np.concatenate([y, np.zeros(2 * count)]), rcond=None)[0]
        coefficients = found[first:]
        turned = np.concatenate(
            [order * coefficients[count:], -order * coefficients[:count]]
        ) * (2 * np.pi * wave.rate_hz)  # fmt: skip
        whole = np.zeros((len(t) + 2 * count + len(walk), last + len(knots)))
        whole[: len(t)] = np.hstack([base, (base[:, first:] @ turned)[:, None] * hats])
        whole[len(t) : len(t) + 2 * count, first:last] = prior
        whole[len(t) + 2 * count :, last:] = noise * walk
        right = np.concatenate([y - base @ found, -prior @ coefficients, -noise * walk @ late])
        move = np.linalg.lstsq(whole, right, rcond=None)[0][last:]
        move = np.clip(move - move.mean(), -MAX_MOVE * period, MAX_MOVE * period)
        late = late + move
        if np.abs(move).max() < SETTLED * period:
            break
    return np.asarray(t + hats @ late)
