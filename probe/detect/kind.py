"""What an object is: its contrast and pulse against the population of solved ones."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from probe.detect.finding import Kind
from probe.detect.prior import KINDS, samples

Array = NDArray[np.float64]

SURE = 0.8
"""Least share of one kind to name it."""
PULSE_FLOOR = 3e-4
"""Pulses (over the force) below this are taken as this: the logarithm needs an end."""
CONTRAST_BLUR, PULSE_BLUR = 0.04, 0.25
"""Widths of a sample's kernel: contrast, and logarithm of the pulse. They stand for what the scenes
leave out (layers, bones, oblique vessels)."""


@dataclass(frozen=True)
class Seen:
    """Contrast (force over its surroundings, less 1) and pulse over force, each with its standard
    deviation; ``pulsing``: the pulse passed its test."""

    contrast: float
    contrast_sd: float
    pulse: float
    pulse_sd: float
    pulsing: bool


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
        limit = 100 * (seen.pulse + 2 * seen.pulse_sd)
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
            sd = max(seen.pulse_sd, 1e-6)
            beat = _hidden(seen.pulse, pulse, sd)
        likelihood[kind] = float(np.mean(peak * beat))
    total = sum(likelihood.values())
    if total <= 0:
        return dict.fromkeys(KINDS, 1 / len(KINDS))
    return {kind: value / total for kind, value in likelihood.items()}


def _hidden(seen: float, pulse: Array, sd: float) -> Array:
    """Likelihood of an insignificant pulse estimate where the true one is ``pulse``.

    An estimate from trough to crest of pure noise is about two standard deviations, not 0.
    """
    expected = np.hypot(pulse, 2 * sd)
    return _normal(max(seen, 2 * sd) - expected, sd)


@lru_cache(maxsize=1)
def _population() -> dict[Kind, tuple[Array, Array]]:
    return {kind: (values[:, 0], values[:, 1]) for kind, values in samples().items()}


def _normal(off: Array, sd: float | Array) -> Array:
    return np.asarray(np.exp(-0.5 * (off / sd) ** 2) / sd)
