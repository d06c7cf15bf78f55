"""The noise that the holds of a scan share: its spectrum is the sensor's, not one hold's.

A short hold cannot tell a pulse from noise of a low frequency; the holds beside it that pulse less
can. So each hold's noise is expected to be one of those that the other holds have.
"""

from collections.abc import Sequence

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import family
from probe.detection.pulse.search import FAR_BEHIND, SHAPE_HARMONICS, Prior, looks_at_hearts

ROUNDS = 50
"""Of expectation-maximisation: 1,000 move no hold's chance of a pulse by more than 2.5 % (180 holds
of 0.8 to 5 s)."""


def noise_priors(holds: Sequence[Hold]) -> list[Prior]:
    """For each hold, the log probability of each noise by what the other holds say.

    The noises are drawn from shares that are unknown: each of the other holds counts as one draw,
    one draw more is spread evenly (a Dirichlet prior of one observation). The shares are found by
    expectation-maximisation (Dempster, Laird & Rubin 1977), each hold left out of its own. With one
    hold all noises are equally likely.
    """
    if not holds:
        return []
    names = sorted({m.name for hold in holds for m in family(hold.step_s, hold.averaged_s)})
    likely = np.array([_likelihoods(hold, names) for hold in holds])
    shares = np.full_like(likely, 1 / len(names))
    for _ in range(ROUNDS):
        drawn = shares * likely
        drawn /= drawn.sum(axis=1, keepdims=True)
        shares = (drawn.sum(axis=0) - drawn + 1 / len(names)) / len(holds)
    return [dict(zip(names, np.log(row), strict=True)) for row in shares]


def _likelihoods(hold: Hold, names: Sequence[str]) -> Array:
    """Likelihood of each noise, whether or not something beats in the hold, over the largest.

    The evidence of a steady wave is its likelihood less half the log of the number of samples for
    each of its coefficients (Schwarz 1978).
    """
    looks, _ = looks_at_hearts(hold)
    unknowns = 2 * SHAPE_HARMONICS
    steady = looks.steady - 0.5 * unknowns * np.log(len(hold.time_s))
    evidence = looks.without + np.logaddexp(0.0, steady)
    evidence -= evidence.max()
    by_name = {m.name: e for m, e in zip(looks.noises, evidence, strict=True)}
    return np.exp([max(by_name.get(name, -np.inf), -FAR_BEHIND) for name in names])
