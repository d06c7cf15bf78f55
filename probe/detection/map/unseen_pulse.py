"""How likely a pulse is to stay unseen at a place that shows none of its own."""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from drivers.core.arrays import Array
from probe.core.finding_words import NORMAL_95
from probe.detection.classify.kinds import SIZES
from probe.detection.map.bumps import Bump
from probe.detection.map.pressed import Pressed
from probe.detection.map.seen_map import bump_at
from probe.detection.pulse.pooled_evidence import hidden

ONE_SIGMA = 0.683
TAIL = 2.0
"""Pulses 16 to 28 mm beside the arteries of a solved row are 0.2 to 1.4 times what `bump_at`
says."""
MOST_SIGMAS, LEAST_TAIL = 30.0, 0.1
"""Deviations: from nothing beyond which odds would overflow, and a tail that changes nothing."""
MIN_SHARE = 0.3
"""Presses that feel less than this share of a pulse are not asked about it."""
MOST_ASKED = 8
"""Presses nearest to a bump that are asked for a hidden pulse: farther ones hardly feel it."""


def unseen(pressed: Pressed, bump: Bump) -> Array:
    """Likelihood of pulses of `SIZES` under a bump of a map in which nothing beats, by all presses
    that would feel one."""
    away = np.argsort(((pressed.place_m - bump.place_m) ** 2).sum(axis=1))
    at = int(away[0])
    wanted_pa = max(float(pressed.level_pa[at]), 1e-9) * SIZES
    share = bump_at(pressed.place_m, bump.shape)
    asked = [
        (share[i], search) for i in away[:MOST_ASKED] if share[i] >= MIN_SHARE
        for search in pressed.searches[i]
    ]  # fmt: skip
    if not asked:
        return measured(float(pressed.pulse_pa[at]), float(pressed.pulse_sd_pa[at]), wanted_pa)
    return hidden([search for _, search in asked], np.array([s for s, _ in asked]), wanted_pa)


def unseen_beside(pressed: Pressed, at: int, beats: Sequence[Bump]) -> tuple[Array, float]:
    """The same at the place ``at`` beside others that beat, whose pulse may be all that is measured
    there; and what is measured beyond it [Pa].

    Far from all of them two thirds of the pulses exceed what these make there by some of their
    stated deviations, at least 1: tremor, or a wrong rate, is in all presses of a map.
    """
    near = [bump_at(pressed.place_m, one.shape) for one in beats]
    tail_pa = TAIL * np.sum([b.height * n for b, n in zip(beats, near, strict=True)], axis=0)
    far = np.max(near, axis=0) < MIN_SHARE
    over = (pressed.pulse_pa - tail_pa) / np.maximum(pressed.pulse_sd_pa, 1e-9)
    stray = max(float(np.quantile(over[far], ONE_SIGMA)), 1.0) if far.any() else 1.0
    size_pa, sd_pa = float(pressed.pulse_pa[at]), stray * float(pressed.pulse_sd_pa[at])
    wanted_pa = max(float(pressed.level_pa[at]), 1e-9) * SIZES
    tail = float(tail_pa[at])
    return measured(size_pa, sd_pa, wanted_pa, tail), max(size_pa - tail, 0.0)


def measured(size_pa: float, sd_pa: float, true_pa: Array, tail_pa: float = 0.0) -> Array:
    """Likelihood (n,) of pulses of ``true_pa`` (n,) beside that of none, where one was measured.

    Of the measured ``size_pa`` anything up to ``tail_pa`` is another's, each part alike.
    """
    sd = max(sd_pa, abs(size_pa) / MOST_SIGMAS, 1e-9)
    size, most = max(size_pa / sd, -NORMAL_95), max(tail_pa / sd, LEAST_TAIL)

    def of(own_pa: Array) -> Array:
        own = own_pa / sd - size
        return np.asarray(ndtr(own + most) - ndtr(own))

    return of(true_pa) / of(np.array(0.0))
