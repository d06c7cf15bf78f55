"""A heart's own unevenness within a hold: when each beat came, from the pulse itself.

A wave of one steady rate smears a pulse whose beats come early and late, and takes it for up to a
third smaller than it is. Where a pulse is clear, its beats are followed.
"""

import numpy as np
from numpy.typing import NDArray

from probe.detect.fit import harmonics
from probe.detect.hold import Hold
from probe.detect.pulse import SHARES, Pulse

Array = NDArray[np.float64]

UNEVEN = 0.06
"""Standard deviation of one beat's length over the mean's (within records: median 4 %, HARDWARE
facts of 95 % below 20 %)."""
FOLLOWED = 5
"""Harmonics that are followed; finer ones only sharpen what these have placed."""
ROUNDS = 6
KNOTS_PER_BEAT = 1.0
MOST_BEATS = 0.25
"""What one round may move a beat by."""


def own_beats_s(hold: Hold, pulse: Pulse) -> Array:
    """Time (n,) [s] counted in the pulse's own beats, as if each lasted as long as the mean.

    Gauss-Newton on the wave and its timing at once. Beforehand each beat's length is normal with a
    standard deviation of `UNEVEN` of the mean (so that timing is a random walk).
    """
    t, period = hold.time_s, 1 / pulse.rate_hz
    knots = np.linspace(t[0], t[-1], max(2, 1 + round(KNOTS_PER_BEAT * hold.span_s / period)))
    hats = np.array([np.interp(t, knots, one) for one in np.eye(len(knots))]).T
    spacing = float(knots[1] - knots[0])
    walk = np.diff(np.eye(len(knots)), axis=0) / (UNEVEN * np.sqrt(period * spacing))
    y = hold.signal_pa - pulse.fit.rest_pa
    weight = np.sqrt(hold.weight)
    noise = max(pulse.noise_pa, 1e-12)
    count = int(np.clip(0.4 * len(t) / max(hold.span_s, 1e-9) // pulse.rate_hz, 1, FOLLOWED))
    shares = np.tile(SHARES[:count], 2) * max(pulse.size_pa, 1e-12)
    drift = np.column_stack([np.ones_like(t), (t - t.mean()) / max(hold.span_s, 1e-9)])
    late = np.zeros(len(knots))
    order = np.arange(1, count + 1)
    waves = 2 * count
    for _ in range(ROUNDS):
        columns = harmonics(t + hats @ late, pulse.rate_hz, count)
        # the wave as it is placed now, then wave and timing together
        prior = np.hstack([np.zeros((waves, 2)), np.diag(noise / shares)])
        a = np.vstack([weight[:, None] * np.hstack([drift, columns]), prior])
        b = np.concatenate([weight * y, np.zeros(waves)])
        coefficients = np.linalg.lstsq(a, b, rcond=None)[0]
        cosines, sines = coefficients[2 : 2 + count], coefficients[2 + count :]
        turned = np.concatenate([order * sines, -order * cosines]) * 2 * np.pi * pulse.rate_hz
        slope = columns @ turned
        left = y - drift @ coefficients[:2] - columns @ coefficients[2:]
        joint = np.hstack([drift, columns, slope[:, None] * hats]) * weight[:, None] / noise
        held = np.zeros((waves, joint.shape[1]))
        held[:, 2 : 2 + waves] = np.diag(1 / shares)
        walking = np.hstack([np.zeros((len(walk), 2 + waves)), walk])
        right = np.concatenate([weight * left / noise, -coefficients[2:] / shares, -walk @ late])
        step = np.linalg.lstsq(np.vstack([joint, held, walking]), right, rcond=None)[0]
        move = step[2 + waves :]
        late = late + np.clip(move, -MOST_BEATS * period, MOST_BEATS * period)
        late = late - late.mean()
        if np.abs(move).max() < 1e-3 * period:
            break
    return np.asarray(t + hats @ late)
