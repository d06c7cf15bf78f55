"""The least noise assumed in a hold, since no sum of decays fits relaxing tissue to the last digit.

What a fit leaves of a relaxation has a shape, and without noise it would pass for a pulse however
small: three decays read without noise leave 5e-5 of the level, trough to crest.
"""

from dataclasses import replace

import numpy as np

from probe.detection.pulse.hold_samples import Hold

LEAST_NOISE = 1e-4
"""Standard deviation over the level, in means of `hold_samples.BIN_S`: a sensor of 0.5 mN and
500 Hz has 2e-4 at 0.8 N. Of 480 holds of 0.8 to 5 s that relax by three or eight decays, a power or
a logarithm of time, read with a tenth of that noise or none, 5 are then called an artery at the 1 %
that is asked for; without, nearly all short ones that were read without noise."""


def least_noise(hold: Hold, seed: int) -> Hold:
    """The hold with `LEAST_NOISE` at least, the same for the same ``seed``."""
    # of third differences: neither a drift nor a relaxation counts
    noise_pa = float(np.median(np.abs(np.diff(hold.signal_pa, 3)))) / (0.6745 * np.sqrt(20))
    least_pa = LEAST_NOISE * abs(float(np.mean(hold.signal_pa)))
    if noise_pa >= least_pa:
        return hold
    more_pa = np.sqrt(least_pa**2 - noise_pa**2)
    noise = np.random.default_rng(seed).standard_normal(len(hold.signal_pa))
    return replace(hold, signal_pa=hold.signal_pa + more_pa * noise)
