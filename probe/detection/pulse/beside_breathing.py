"""A pulse beside breathing, which moves the tissue at the same time.

Alone, neither explains such a hold: the breath is noise to the pulse, and breathing with harmonics
enough for both the likelier cause. So a pulse is also judged with a breath's harmonics taken out.
"""

from dataclasses import replace

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.beat_train import Coarse
from probe.detection.pulse.fit import harmonics
from probe.detection.pulse.periodic import mean_wave

BREATHING_HZ = (0.1, 0.6)
"""6 to 36 breaths a minute."""
MOST_BESIDE = 2
"""Harmonics of a breath beside a pulse: further ones are at the rates of hearts."""
BESIDE_MEMORIES = (0.0,)
"""Noise beside a breath is white: a breath and a random walk would both explain what is slow.
Of ten random walks in 80 that pass as a pulse two are taken for one; were noise to be a random walk
too, five."""


def beside_breathing(hold: Coarse, slowest_hz: float, fastest_hz: float) -> tuple[Coarse, float]:
    """The hold without the breath beside which a mean wave is likeliest, and the log of what
    choosing that breath costs.

    The wave is looked for at ``slowest_hz`` to ``fastest_hz``. A breath costs its rate and two
    unknowns for each harmonic (Schwarz 1978); its first harmonic is its largest.
    """
    n = len(hold.signal)
    time_s = np.asarray(np.arange(n) * hold.step_s, dtype=float)
    independent = 1 + (BREATHING_HZ[1] - BREATHING_HZ[0]) * n * hold.step_s
    best, most = (hold, np.inf), -np.inf
    for rate_hz in np.linspace(*BREATHING_HZ, int(4 * independent)):
        for count in range(1, MOST_BESIDE + 1):
            breath = harmonics(time_s, float(rate_hz), count)
            if not _is_breath(hold, breath):
                continue
            other = _without(hold, breath)
            cost = float(np.log(independent) + count * np.log(n))
            found = mean_wave(other, slowest_hz, fastest_hz, BESIDE_MEMORIES, refined=0) - cost
            if found > most:
                best, most = (other, cost), found
    return best


def _is_breath(hold: Coarse, breath: Array) -> bool:
    """Whether the first of harmonics (n, 2 count) is the largest in the hold."""
    sizes, *_ = np.linalg.lstsq(np.hstack([breath, hold.nuisance]), hold.signal, rcond=None)
    return bool(np.hypot(*sizes[: breath.shape[1]].reshape(2, -1)).argmax() == 0)


def _without(hold: Coarse, columns: Array) -> Coarse:
    nuisance = np.hstack([hold.nuisance, columns])
    q, _ = np.linalg.qr(nuisance)
    return replace(hold, signal=hold.signal - q @ (q.T @ hold.signal), nuisance=nuisance)
