"""Quantisation of a drifting level: a sawtooth that looks like a pulse.

A smooth level s, read in steps q with noise of a standard deviation sigma, is off on average by the
sum over k of (-1)^k q / (pi k) exp(-2 (pi k sigma / q)^2) sin(2 pi k s / q) (Widrow & Kollar 2008,
Quantization Noise). Its sines are fitted beside the level and taken out, each at most as large as
without noise.
"""

from dataclasses import replace

import numpy as np

from probe.detection.pulse.fit import design_of, fit
from probe.detection.pulse.hold_samples import Hold

SINES = 4
"""Of the sawtooth: further ones are below a fifth of the first."""
ROUNDS = 3
"""Of the level and its sawtooth in turns. Of 40 drifts of a step a second, read in steps at 100 and
500 Hz, one round leaves three that are called a pulse, three rounds one."""


def unrounded(hold: Hold) -> Hold:
    """The hold without what rounding makes of its level."""
    found = hold
    for _ in range(ROUNDS if hold.quantum_pa else 0):
        design = design_of(found)
        level = fit(found, design, np.empty((len(hold.time_s), 0))).rest_pa
        order = np.arange(1, SINES + 1)
        turns = 2 * np.pi * (level - hold.code_pa)[:, None] / hold.quantum_pa
        sines = (-1.0) ** order * hold.quantum_pa / (np.pi * order) * np.sin(turns * order)
        q, _ = np.linalg.qr(design.drift)
        share = np.linalg.lstsq(sines - q @ (q.T @ sines), hold.signal_pa - level, rcond=None)[0]
        found = replace(hold, signal_pa=hold.signal_pa - sines @ np.clip(share, 0.0, 1.0))
    return found


def within_steps(hold: Hold, seed: int) -> Hold:
    """The hold anywhere within steps that no noise reaches over, as sure as it has stretches: all
    readings of one say no more than one does.

    Taken for exact, they would make the clearest pulse of the computer's own rounding.
    """
    if not hold.stretches:
        return hold
    count = len(hold.signal_pa)
    spread_pa = hold.quantum_pa * np.sqrt(count / hold.stretches)
    within = np.random.default_rng(seed).uniform(-0.5, 0.5, count)
    return replace(hold, signal_pa=hold.signal_pa + spread_pa * within)
