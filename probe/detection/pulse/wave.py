"""The brachial wave: what an arterial pulse looks like where nothing else is known.

Mean of 8 subjects (repat8/cam-bpw-sim-pub), scaled to 120 over 80 mmHg.
"""

import numpy as np

from drivers.core.arrays import Array

AMPLITUDES_MMHG = np.array([13.94, 7.88, 4.43, 2.55, 2.20, 1.53, 0.98, 0.62])
PHASES_RAD = np.array([-1.727, -2.203, -2.906, -3.057, 2.860, 2.368, 1.988, 1.752])
SWING_MMHG = 40.0
"""From trough to crest."""


def _pressure(phase: Array) -> Array:
    turns = 2 * np.pi * phase[..., None] * np.arange(1, len(AMPLITUDES_MMHG) + 1)
    return np.asarray((AMPLITUDES_MMHG * np.cos(turns + PHASES_RAD)).sum(axis=-1))


_FOOT = float(np.argmin(_pressure(np.arange(1000) / 1000))) / 1000


def brachial(phase: Array) -> Array:
    """The wave without its mean, of a swing of 1, at phases in beats from its foot."""
    return np.asarray(_pressure(phase + _FOOT) / SWING_MMHG)
