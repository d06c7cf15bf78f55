"""The noise of a hold: a family of spectra, and which of them the hold is likely to have.

No member has a peak at a finite frequency, so none can take a pulse for noise. Power spectra over
frequency f, with a knee at k:

- white: 1;
- random walk and white noise: 1 + (k/f)^2;
- integrated random walk (a smooth drift) and white noise: 1 + (k/f)^4;
- low-pass noise, of a first-order filter: 1 / (1 + (f/k)^2);
- flicker and white noise, as of electronics: 1 + k/f.

Means of a random walk are smoother than the walk (Working 1960), so that a hold of means has
another spectrum than one of single samples. If the integrated walk and the low-pass noise were
averaged too, movements would be taken for noise: of 48 pulses beside one ten times as large 20
would be found, not 44 (500 Hz).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dtbtrs

from drivers.core.arrays import Array

RANDOM_WALK_HZ = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
INTEGRATED_WALK_HZ = (0.25, 0.5, 1.0)
LOW_PASS_HZ = (1.0, 3.0, 8.0)
"""Knees, about an octave apart: between two a likelihood changes by less than a test sees."""
FLICKER_HZ, FLICKER_LOWEST_HZ = (1.0, 4.0, 16.0), 0.05
"""Knees, and where it ends: a level and a drift take what is slower. It matters little: of 1,200
holds of noise like f^-0.8 to f^-1.3 (2.5 and 5 s, 10 to 500 Hz) 49 are called an artery without it
and 40 with it, of 480 by benchmarks/artefacts.py 20 both times; of 600 pulses of people the same
563 are found."""

MAX_WALK_KNEE, MAX_KNEE = 0.65, 0.25
"""Highest knee over the rate of the samples: of random walk and flicker, and of the others. With no
random walk above the second 3.0 % of 400 random walks at 500 Hz are called an artery and 27 %
*undecided*, with it 1.5 and 5 %, and one more, of 64 Hz, changes none. At 10 Hz it is 3.2 and 17 %
of 1,000 without, and 2.3 and 11 % with it, 1.6 and 10 % with one more (benchmarks/artefacts.py,
seeds of their own); but of 200 pulses of 3 % in 2.5 s (benchmarks/pulses.py) 190 are found, 189,
and 186."""
MIN_LOG_RATIO = 2.0
"""Log likelihood ratio over white noise at the 5 % level of a chi-square of one degree."""


@dataclass(frozen=True)
class Noise:
    """Innovations e of samples x: ``sum back[k] e[i - k] = sum ahead[k] x[i - k]``; the first is
    ``first`` times a sample.

    Both polynomials begin with 1, so that all members have the same determinant and differ in the
    likelihood by the sum of squared innovations only.
    """

    name: str
    ahead: tuple[float, ...]
    back: tuple[float, ...]
    first: float = 1.0

    def whiten(self, columns: Array) -> Array:
        """Innovations (n, ...) of columns (n, ...)."""
        if len(self.ahead) == 1:
            return columns
        white = columns * self.ahead[0]
        for lag, share in enumerate(self.ahead[1:], 1):
            white[lag:] += share * columns[:-lag]
        white = _recursive(self.back, white)
        white[0] *= self.first
        return white


def _recursive(back: tuple[float, ...], columns: Array) -> Array:
    """y (n, ...) with ``sum back[k] y[i - k]`` = ``columns``: a triangular system of few bands.
    (Not scipy.signal.lfilter: importing it takes as long as all of a scan's detection.)"""
    if len(back) == 1 or not columns.size:
        return columns
    n = len(columns)
    found, _ = dtbtrs(_bands(back, n), columns.reshape(n, -1), uplo="L", diag="U")
    return np.asarray(found.reshape(columns.shape))


@lru_cache(maxsize=64)
def _bands(back: tuple[float, ...], n: int) -> Array:
    """Diagonals (bands, n) as LAPACK has them."""
    return np.asfortranarray(np.repeat(np.array(back)[:, None], n, axis=1))


WHITE = Noise("white", (1.0,), (1.0,))


@lru_cache(maxsize=32)
def family(step_s: float, averaged_s: float = 0.0) -> tuple[Noise, ...]:
    """The members that means over ``averaged_s``, ``step_s`` apart, can tell from each other."""
    walks = [hz for hz in RANDOM_WALK_HZ if hz * step_s <= MAX_WALK_KNEE]
    return (
        WHITE,
        *(_random_walk(hz, step_s, averaged_s) for hz in walks),
        *(_integrated_walk(hz, step_s) for hz in INTEGRATED_WALK_HZ if hz * step_s <= MAX_KNEE),
        *(_low_pass(hz, step_s) for hz in LOW_PASS_HZ if hz * step_s <= MAX_KNEE),
        *(_flicker(hz, step_s) for hz in FLICKER_HZ if hz * step_s <= MAX_WALK_KNEE),
    )


def _random_walk(knee_hz: float, step_s: float, averaged_s: float) -> Noise:
    # increments of a walk's means, and white noise's: a moving average of two (Working 1960)
    walk, share = (2 * np.pi * knee_hz * step_s) ** 2, averaged_s / step_s
    power, beside = 2 + walk * (1 - share / 3), walk * share / 6 - 1
    back = 2 * beside / (power + np.sqrt(power**2 - 4 * beside**2))
    return Noise(f"random walk {knee_hz:g} Hz", (1.0, -1.0), (1.0, float(back)))


def _integrated_walk(knee_hz: float, step_s: float) -> Noise:
    # |1 - z|^4 + (2 pi k dt)^4 factored: the roots inside the unit circle
    side = 2 + 1j * (2 * np.pi * knee_hz * step_s) ** 2
    root = min(np.roots([1.0, -side, 1.0]), key=abs)
    back = np.real(np.poly([root, root.conjugate()]))
    return Noise(f"integrated walk {knee_hz:g} Hz", (1.0, -2.0, 1.0), tuple(float(b) for b in back))


def _low_pass(knee_hz: float, step_s: float) -> Noise:
    kept = float(np.exp(-2 * np.pi * knee_hz * step_s))
    return Noise(f"low pass {knee_hz:g} Hz", (1.0, -kept), (1.0,), float(np.sqrt(1 - kept**2)))


def _flicker(knee_hz: float, step_s: float) -> Noise:
    # a zero at the knee, a pole an octave below, a zero an octave below that (Keshner 1982)
    zeros = knee_hz / 4.0 ** np.arange(np.ceil(np.log(knee_hz / FLICKER_LOWEST_HZ) / np.log(4.0)))
    ahead, back = (np.poly(np.exp(-2 * np.pi * hz * step_s)) for hz in (zeros / 2, zeros))
    return Noise(
        f"flicker {knee_hz:g} Hz", tuple(float(a) for a in ahead), tuple(float(b) for b in back)
    )


def likeliest(residual: Array, step_s: float, averaged_s: float = 0.0) -> Noise:
    """The likeliest member for a residual (n,); `WHITE` unless another beats it by `MIN_LOG_RATIO`.

    Without pulse columns a pulse's own unevenness would count as noise: take what a pulse leaves.
    """
    n = len(residual)
    members = family(step_s, averaged_s)
    centred = residual - residual.mean()
    power = np.array([max(float((w := m.whiten(centred)) @ w), 1e-300) for m in members])
    gain = 0.5 * n * np.log(power[0] / power)
    best = int(np.argmax(gain))
    return members[best] if gain[best] >= MIN_LOG_RATIO else WHITE
