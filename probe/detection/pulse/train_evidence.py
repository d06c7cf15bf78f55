"""How likely a hold is if what moves in it is a train of beats, relaxation and drift beside it.

The train is found in a hold without what those could take; as of a rival, they are fitted again.
"""

import numpy as np

from probe.detection.pulse.beat_train import MEMORIES, BeatTrain, Coarse, whiten

NYQUIST_SHARE = 0.45
"""Of the sampling rate: harmonics above are not looked at."""
SAMPLES_EACH = 4.0
"""Samples at least for each unknown (a harmonic has two, a movement its time, length and size):
with fewer, breathing or motion of enough parts explains any hold."""


def train_evidence(hold: Coarse, train: BeatTrain) -> float:
    """Log evidence of a train of beats (as `BeatTrain.log_evidence`) beside relaxation and drift.

    What other trains add to the best one's likelihood is taken from ``train``.
    """
    n = len(hold.signal)
    left = hold.signal - train.wave(*train.beats_at(np.asarray(np.arange(n) * hold.step_s)))
    plain, found = -np.inf, -np.inf
    for memory in MEMORIES:
        first = int(memory == 1.0)
        beside, _ = np.linalg.qr(whiten(hold.nuisance, memory)[first:])
        white = whiten(left, memory)[first:]
        power = float(white @ white)
        rest = power - float(((beside.T @ white) ** 2).sum())
        plain = max(plain, -0.5 * (n - first) * (np.log(max(power, 1e-300) / (n - first)) + 1))
        found = max(found, -0.5 * (n - first) * (np.log(max(rest, 1e-300) / (n - first)) + 1))
    return train.log_evidence + found - plain
