"""What an object is: its contrast and pulse against the population of solved ones."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ncx2

from probe.detect.finding import Kind
from probe.detect.prior import KINDS, samples

Array = NDArray[np.float64]

SURE = 0.8
"""Least share of one kind to name it."""
HIDDEN = 5.0
"""Standard deviations of its size up to which a pulse can stay hidden."""
PULSE_FLOOR = 3e-4
"""Pulses (over the force) below this are taken as this: the logarithm needs an end."""
CONTRAST_BLUR, PULSE_BLUR = 0.04, 0.25
"""Widths of a sample's kernel: contrast, and logarithm of the pulse. They stand for what the scenes
leave out (layers, bones, oblique vessels)."""


@dataclass(frozen=True)
class Seen:
    """Contrast (force over its surroundings, less 1) and pulse over force, each with its standard
    deviation; ``pulsing``: the pulse passed its test, whose chance was ``chance`` in ``tries``
    rates."""

    contrast: float
    contrast_sd: float
    pulse: float
    pulse_sd: float
    pulsing: bool
    chance: float
    tries: float


@dataclass(frozen=True)
class Judged:
    """The kind with its share among all kinds; ``reason`` says why it is undecided, and what would
    decide it."""

    kind: Kind
    confidence: float
    reason: str


def judge(seen: Seen) -> Judged:
    """The kind of an object that was found."""
    share = shares(seen)
    best = max(share, key=lambda k: share[k])
    if share[best] >= SURE:
        return Judged(best, share[best], "")
    told = ", ".join(f"{k} {100 * v:.0f} %" for k, v in share.items())
    if seen.pulsing:
        advice = "press deeper, or hold for more beats, to know the pulse and the peak better"
    else:
        limit = 100 * HIDDEN * seen.pulse_sd
        advice = (
            f"a pulse of up to {limit:.2g} % of the force could be hidden: hold for more beats, "
            "repeat, or take a quieter sensor"
        )
    return Judged("undecided", share[best], f"between {told}; {advice}")


def shares(seen: Seen) -> dict[Kind, float]:
    """How well each kind's solved samples explain what was seen, normalised over the kinds.

    A lump has no pulse: it is judged by whether as little was seen; vessels by the likelihood of
    their pulses, where one was found as its measured size, else as any size that could hide.
    """
    likelihood: dict[Kind, float] = {}
    for kind, (contrast, pulse) in _population().items():
        peak = _normal(seen.contrast - contrast, np.hypot(seen.contrast_sd, CONTRAST_BLUR))
        if seen.pulsing:
            size = max(seen.pulse, PULSE_FLOOR)
            blur = np.hypot(PULSE_BLUR, min(seen.pulse_sd / size, 2.0))
            beat = _normal(np.log(size) - np.log(np.maximum(pulse, PULSE_FLOOR)), blur)
            beat = beat if kind != "tumour" else 1e-6 * beat
        else:
            beat = _hidden(seen, pulse)
        likelihood[kind] = float(np.mean(peak * beat))
    total = sum(likelihood.values())
    if total <= 0:
        return dict.fromkeys(KINDS, 1 / len(KINDS))
    return {kind: value / total for kind, value in likelihood.items()}


def _hidden(seen: Seen, pulse: Array) -> Array:
    """Likelihood of what the search for a pulse found, if the true one were ``pulse`` (n,).

    The search's statistic is the largest of ``tries`` chi-squares of two degrees; at the true rate
    it is a noncentral one.
    """
    one = -np.expm1(np.log1p(-min(seen.chance, 1 - 1e-9)) / seen.tries)
    statistic = -2 * np.log(max(one, 1e-300))
    shift = np.minimum((pulse / max(seen.pulse_sd, 1e-9)) ** 2, 1e4)
    rest, at = (1 - one) ** (seen.tries - 1), (statistic, 2)
    here = ncx2.pdf(*at, shift) * rest
    elsewhere = (seen.tries - 1) * 0.5 * one * rest / max(1 - one, 1e-9) * ncx2.cdf(*at, shift)
    return np.asarray(here + elsewhere)


@lru_cache(maxsize=1)
def _population() -> dict[Kind, tuple[Array, Array]]:
    return {kind: (values[:, 0], values[:, 1]) for kind, values in samples().items()}


def _normal(off: Array, sd: float | Array) -> Array:
    return np.asarray(np.exp(-0.5 * (off / sd) ** 2) / sd)
