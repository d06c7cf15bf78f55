"""What an object is: its contrast and pulse against the population of solved ones."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from probe.detect.finding import Kind
from probe.detect.prior import KINDS, samples

Array = NDArray[np.float64]

SURE = 0.85
"""Least share of one kind to name it."""
SIZES = np.geomspace(1e-5, 1.0, 101)
UNLIKELY = 0.05
"""Pulses over the force; one so much less likely than none would have shown."""
PULSE_FLOOR = 3e-4
"""Pulses (over the force) below this are taken as this: the logarithm needs an end."""
CONTRAST_BLUR, CONTRAST_SHARE, PULSE_BLUR = 0.04, 0.1, 0.25
"""Widths of a sample's kernel: contrast, with a share of the contrast itself, and logarithm of the
pulse. They stand for what the scenes leave out (layers, bones, oblique vessels)."""


@dataclass(frozen=True)
class Seen:
    """Contrast (force over its surroundings, less 1) and pulse over force, each with its standard
    deviation. Where no pulse was seen, ``hidden`` is the likelihood (n,) that pulses (n,) over the
    force have beside that of none."""

    contrast: float
    contrast_sd: float
    pulse: float
    pulse_sd: float
    hidden: Callable[[Array], Array] | None = None


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
    if seen.hidden is None:
        advice = "press deeper, or hold for more beats, to know the pulse and the peak better"
    else:
        could = SIZES[seen.hidden(SIZES) >= UNLIKELY].max(initial=SIZES[0])
        advice = (
            f"a pulse of up to {100 * could:.2g} % of the force could be hidden: hold for more "
            "beats, repeat, or take a quieter sensor"
        )
    return Judged("undecided", share[best], f"between {told}; {advice}")


def shares(seen: Seen) -> dict[Kind, float]:
    """How well each kind's solved samples explain what was seen, normalised over the kinds.

    Where a pulse was found vessels are judged by the likelihood of their pulses as its size; where
    none was, every kind by how likely its pulses, a lump's none, are to stay unseen.
    """
    likelihood: dict[Kind, float] = {}
    for kind, (contrast, pulse) in _population().items():
        blur = np.hypot(CONTRAST_BLUR, CONTRAST_SHARE * contrast)
        peak = _normal(seen.contrast - contrast, np.hypot(seen.contrast_sd, blur))
        if seen.hidden is None:
            size = max(seen.pulse, PULSE_FLOOR)
            blur = np.hypot(PULSE_BLUR, min(seen.pulse_sd / size, 2.0))
            beat = _normal(np.log(size) - np.log(np.maximum(pulse, PULSE_FLOOR)), blur)
            beat = beat if kind != "tumour" else 1e-6 * beat
        else:
            beat = seen.hidden(pulse)
        likelihood[kind] = float(np.mean(peak * beat))
    total = sum(likelihood.values())
    if total <= 0:
        return dict.fromkeys(KINDS, 1 / len(KINDS))
    return {kind: value / total for kind, value in likelihood.items()}


@lru_cache(maxsize=1)
def _population() -> dict[Kind, tuple[Array, Array]]:
    return {kind: (values[:, 0], values[:, 1]) for kind, values in samples().items()}


def _normal(off: Array, sd: float | Array) -> Array:
    return np.asarray(np.exp(-0.5 * (off / sd) ** 2) / sd)
