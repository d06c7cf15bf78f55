"""The kind of an object: what was measured of it, compared with a population of solved ones."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from drivers.core.arrays import Array
from probe.core.finding_words import percent
from probe.detection.classify.population import STRATA, Stratum, World, samples
from probe.detection.finding import (
    HEALTHY,
    LUMP,
    MAX_CONFIDENCE,
    NAMED,
    NARROWED,
    UNDECIDED,
    VESSELS,
    Kind,
    stated,
)

MIN_POSTERIOR = 0.85
"""Least posterior probability of a kind to name it."""
SIZES = np.geomspace(1e-5, 1.0, 101)
"""Pulses over the force at which it is asked how likely they are to stay unseen."""
HIDDEN_RATIO = 0.05
"""A pulse so much less likely than none would have shown."""
PULSE_FLOOR = 3e-4
"""Pulses (over the force) below this are taken as this: the logarithm needs an end."""
CONTRAST_BLUR, CONTRAST_SHARE, PULSE_BLUR, MODULUS_BLUR = 0.04, 0.1, 0.25, 0.3
"""Widths of a sample's kernel: contrast, with a share of the contrast itself, and logarithms of the
pulse and of the apparent modulus. They stand for what the scenes leave out (layers, bones, oblique
vessels); solved fingers are 10 mm long, and one of 5 or 20 mm moves the modulus by 0.35."""
ELSE = "something else"
ONE_PRESS, UNEVEN_ROW = "one press that differs", "an uneven row"
EVEN = "between "
"""How the reason begins of what is undecided because its chances are too even, and for no other."""
MIN_REASON = 0.1
"""Least probability of one of these to say what would decide about it."""
REASONS = {
    ONE_PRESS: "a single press differs from its neighbours: repeat it, and press beside it",
    UNEVEN_ROW: "the whole row is uneven (surface, tall block, or bone at one side), so this bump "
    "may be no object: measure the surface at each station, extend the row past its stiffer end, "
    "or scan a row across this one",
}
PRIOR: dict[str, float] = {LUMP: 0.3, HEALTHY: 0.3, NARROWED: 0.3, ELSE: 0.1}
"""Of an object that is there: the three kinds alike, a tenth for what none of them is."""
CONTRASTS = (-0.3, 3.0)
"""Range of contrasts over which something else is spread evenly; of its pulses the logarithm is,
from `PULSE_FLOOR` to 1."""
MODULI = (1e2, 1e8)
"""Range [Pa] over which the logarithm of something else's apparent modulus is spread evenly: a
hundred times beyond fat and bone. Forces in another unit are a thousand times off."""
BEYOND = 0.01
"""Of something else, the chance of a contrast beyond those, half to either side, less by the square
of 1 and the distance: where a zero is off it may be any. Without it a kind of which next to nothing
is left takes all: 38 of 40 arteries whose levels were shifted to near zero were a tumour at
99.9 %."""


@dataclass(frozen=True)
class Seen:
    """Pulse over force with its standard deviation, and where it is known the contrast (force over
    its surroundings, less 1) with its own, or the apparent modulus [Pa] of a press without
    neighbours, in any of ``worlds``, all alike beforehand.

    ``chance`` is that of a bump as clear where nothing lies, ``moving`` the posterior probability
    that what moves is a pulse. Where no pulse was seen, ``hidden`` is the likelihood that `SIZES`
    have beside that of none, ``alone`` the odds that one press differs by itself, as one that goes
    deeper than the stage knows, against a bump, and ``uneven`` those that the row waves as over an
    uneven surface, or is stiffer on one side."""

    pulse: float
    pulse_sd: float
    contrast: float = math.nan
    contrast_sd: float = math.nan
    modulus_pa: float = math.nan
    worlds: Sequence[World] = ("above",)
    chance: float = 0.0
    moving: float = 1.0
    hidden: Array | None = None
    alone: float = 0.0
    uneven: float = 0.0


@dataclass(frozen=True)
class Judged:
    """The kind with its posterior probability; ``reason`` says why it is undecided, and what would
    decide it. ``diseased``: that it is no healthy vessel, if it is a vessel: what is stiff without
    a pulse then is a stenosis. ``stiff``: that it gives way less than a healthy one, if it is a
    vessel, NaN where it is likelier none. ``chances`` are the posterior probabilities of all
    kinds."""

    kind: Kind
    confidence: float
    reason: str
    diseased: float
    stiff: float = math.nan
    chances: Mapping[str, float] = field(default_factory=dict)


def judge(seen: Seen, advice: str = "") -> Judged:
    """The kind of an object that was found; ``advice`` says what would decide it, in place of a
    better press or a longer hold."""
    share, stiff = posterior(seen)
    best = max(share, key=lambda k: share[k])
    if sum(share[kind] for kind in VESSELS) < 0.5:
        stiff = math.nan
    not_healthy = share[NARROWED] + share[LUMP]
    diseased = not_healthy / max(not_healthy + share[HEALTHY], 1e-300)
    kind = next((kind for kind in NAMED if kind == best), None)
    if kind is not None and share[best] >= MIN_POSTERIOR:
        return Judged(kind, stated(share[best]), "", diseased, stiff, share)
    rival = max(REASONS, key=lambda k: share[k])
    if share[rival] >= MIN_REASON:
        return Judged(UNDECIDED, stated(share[best]), REASONS[rival], diseased, stiff, share)
    chances = ", ".join(f"{k} {percent(stated(v))}" for k, v in share.items() if v >= 0.005)
    if seen.hidden is not None:
        could = SIZES[seen.hidden >= HIDDEN_RATIO].max(initial=SIZES[0])
        advice = (
            f"a pulse of up to {100 * could:.2g} % of the force could be hidden: hold for more "
            "beats, repeat, or take a quieter sensor"
        )
    elif best == ELSE:
        advice = "no solved vessel or lump is so: check the zero, the unit and face_mm2"
    reason = f"{EVEN}{chances}; " + (
        advice or "press deeper, or hold for more beats, to know the pulse and the peak better"
    )
    return Judged(UNDECIDED, stated(share[best]), reason, diseased, stiff, share)


def posterior(seen: Seen) -> tuple[dict[str, float], float]:
    """Posterior probability of each kind, of something else, of one press that differs, of an
    uneven row and of nothing; and that a vessel is stiff, if it is one.

    A stratum's likelihood is the mean over its solved samples. Where a pulse was found, vessels are
    judged by the likelihood of their pulses as its size, and a lump only by the chance that what
    moves is none. Where none was, every kind is judged by how likely its pulses, a lump's none, are
    to stay unseen.
    """
    likelihood = dict.fromkeys((*PRIOR,), 0.0)
    stiff = vessel = 0.0
    for (name, world), solved in _solved().items():
        if world not in seen.worlds:
            continue
        stratum = STRATA[name]
        prior = PRIOR[stratum.kind] * stratum.share / len(seen.worlds)
        each = prior * _likelihood(seen, stratum, solved)
        likelihood[stratum.kind] += each
        if stratum.beats:
            vessel += each
            stiff += each * stratum.stiff
    likelihood[ELSE] = PRIOR[ELSE] * max(_anything(seen), 1e-300)
    total = sum(likelihood.values())
    nothing = against_nothing(seen.chance)
    something = 1 / (1 + nothing + seen.alone + seen.uneven)
    share = {kind: something * value / total for kind, value in likelihood.items()}
    rivals = {"nothing": nothing, ONE_PRESS: seen.alone, UNEVEN_ROW: seen.uneven}
    share |= {rival: something * odds for rival, odds in rivals.items()}
    return share, stiff / vessel if vessel > 0 else math.nan


def against_nothing(chance: float) -> float:
    """Odds of nothing against something that has this ``chance`` where nothing lies, both alike
    beforehand: at least ``-e p ln p`` (Sellke, Bayarri & Berger 2001)."""
    p = min(max(chance, 1e-300), 1 / math.e)
    return float(-math.e * p * np.log(p))


def _likelihood(seen: Seen, stratum: Stratum, solved: Array) -> float:
    contrast, pulse, modulus_pa = solved.T
    here = np.ones(len(solved))
    if np.isfinite(seen.contrast):
        blur = np.hypot(CONTRAST_BLUR, CONTRAST_SHARE * contrast)
        here = here * _normal(seen.contrast - contrast, np.hypot(seen.contrast_sd, blur))
    if np.isfinite(seen.modulus_pa):
        here = here * _normal(np.log(seen.modulus_pa / modulus_pa), MODULUS_BLUR)
    if seen.hidden is not None:
        unseen = np.interp(np.log(np.maximum(pulse, SIZES[0])), np.log(SIZES), seen.hidden)
        unseen = np.where(pulse < SIZES[0], 1.0, unseen)  # a sensor may be quieter than that
        return float(np.mean(here * unseen))
    false = max(1 - seen.moving, 1 - MAX_CONFIDENCE)
    if not stratum.beats:
        return float(np.mean(here)) * false * _any_pulse()
    size = max(seen.pulse, PULSE_FLOOR)
    spread = np.hypot(PULSE_BLUR, min(seen.pulse_sd / size, 2.0))
    beat = _normal(np.log(size) - np.log(np.maximum(pulse, PULSE_FLOOR)), spread)
    return float(np.mean(here * beat)) * (1 - false)


def _anything(seen: Seen) -> float:
    """The likelihood of something of which nothing is known."""
    density = _any_pulse()
    if seen.hidden is not None:
        density = float(np.mean(seen.hidden[SIZES >= PULSE_FLOOR]))
    if np.isfinite(seen.modulus_pa):
        density /= float(np.log(MODULI[1] / MODULI[0]))
    if np.isfinite(seen.contrast):
        low, high = CONTRASTS
        spread = seen.contrast_sd if seen.contrast_sd > 0 else CONTRAST_BLUR
        inside = float(np.diff(ndtr((np.array([low, high]) - seen.contrast) / spread))[0])
        off = max(seen.contrast - high, low - seen.contrast, 0.0)
        density *= inside / (high - low) + BEYOND / 2 / (1 + off) ** 2
    return density


def _any_pulse() -> float:
    """Density of the logarithm of a pulse over the force that nothing is known of."""
    return float(-1 / np.log(PULSE_FLOOR))


@lru_cache(maxsize=1)
def _solved() -> dict[tuple[str, World], Array]:
    return samples()


def _normal(off: Array, sd: float | Array) -> Array:
    return np.asarray(np.exp(-0.5 * (off / sd) ** 2) / (sd * np.sqrt(2 * np.pi)))
