"""A train of beats in the shape that the hold's own beats have on average.

The train is found with the mean wave of other people. A loud pulse shows how its own differs: beats
laid over each other (in phase, each in its own size) show harmonics that the mean wave lacks.
"""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.beat_train import MEMORIES, BeatTrain, Coarse, whiten
from probe.detection.pulse.wave import brachial

NYQUIST_SHARE = 0.45
"""Of the sampling rate: harmonics above are not looked at."""
SAMPLES_EACH = 4.0
"""Samples at least for each unknown (a harmonic has two, a movement its time, length and size):
with fewer, breathing or motion of enough parts explains any hold."""
HARMONICS = 2 * np.fft.rfft(brachial(np.arange(256) / 256))[1:9] / 256
"""Of the mean wave: its cosine's size, less i times its sine's."""


def shape_evidence(hold: Coarse, train: BeatTrain, most: int) -> float:
    """Log evidence of a train of beats (as `BeatTrain.log_evidence`) that have the wave of
    ``train`` and up to ``most`` harmonics of their own, beside relaxation and drift.

    A wave whose first harmonic is not its largest is none: it beats twice or more in a beat. What
    other trains add to the best one's likelihood is taken from ``train``; two unknowns for
    each harmonic cost log n (Schwarz 1978), and each number of harmonics is as likely beforehand.
    """
    n = len(hold.signal)
    phase, swing = train.beats_at(np.asarray(np.arange(n) * hold.step_s, dtype=float))
    usual_s = float(np.median(train.lengths_s))
    most = min(most, int(NYQUIST_SHARE / hold.step_s * usual_s), int((n / SAMPLES_EACH - 1) / 2))
    turn = 2 * np.pi * phase[:, None] * np.arange(1, most + 1)
    size_pa = float(swing.mean())
    size = swing[:, None] / size_pa
    own = [size * part for part in (np.cos(turn), np.sin(turn))]
    paired = np.stack(own, axis=2).reshape(n, -1)  # cosine and sine of the first, of the second ...
    left = hold.signal - train.wave(phase, swing)
    plain, found = -np.inf, -np.inf
    for memory in MEMORIES:
        rows = n - (memory == 1.0)
        beside, _ = np.linalg.qr(whiten(hold.nuisance, memory)[int(memory == 1.0) :])
        white = whiten(left, memory)[int(memory == 1.0) :]
        columns = whiten(paired, memory)[int(memory == 1.0) :]
        q, r = np.linalg.qr(columns - beside @ (beside.T @ columns))
        power = float(white @ white)
        rest = power - float(((beside.T @ white) ** 2).sum())
        along = q.T @ white
        drops = (along**2).reshape(-1, 2).sum(axis=1)
        each = np.maximum(rest - np.concatenate([[0.0], np.cumsum(drops)]), 1e-300)
        score = -0.5 * rows * np.log(each / rows) - 0.5 * rows - np.arange(most + 1) * np.log(n)
        score[1:][[not _is_beat(r, along, k, size_pa) for k in range(1, most + 1)]] = -np.inf
        plain = max(plain, -0.5 * rows * np.log(max(power, 1e-300) / rows) - 0.5 * rows)
        found = max(found, float(np.logaddexp.reduce(score)) - np.log(most + 1))
    return train.log_evidence + found - plain


def _is_beat(triangle: Array, along: Array, count: int, size_pa: float) -> bool:
    """Whether a mean wave of ``size_pa`` with ``count`` harmonics has the first as its largest."""
    own = np.linalg.lstsq(triangle[: 2 * count, : 2 * count], along[: 2 * count], rcond=None)[0]
    whole = size_pa * HARMONICS[:count] + own[::2] - 1j * own[1::2]
    return bool(np.abs(whole).argmax() == 0)
