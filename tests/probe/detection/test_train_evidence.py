"""A train of beats beside relaxation and drift."""

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.beat_train import BeatTrain, Coarse
from probe.detection.pulse.train_evidence import train_evidence
from probe.detection.pulse.wave import brachial

STEP_S, BEAT_S, COUNT = 0.1, 1.2, 50


def train() -> BeatTrain:
    """Even beats of equal size."""
    begins = BEAT_S * np.arange(5)
    return BeatTrain(0.0, begins, np.full(5, BEAT_S), np.ones(5))


def hold(wave: Array, seed: int) -> Coarse:
    t = np.arange(COUNT) * STEP_S
    noise = 0.02 * np.random.default_rng(seed).standard_normal(COUNT)
    return Coarse(wave + noise, STEP_S, np.column_stack([np.ones_like(t), t - t.mean()]))


def phase() -> Array:
    return np.asarray((np.arange(COUNT) * STEP_S / BEAT_S) % 1.0)


def test_drift_beside_the_beats_costs_nothing() -> None:
    """As it costs a rival nothing: relaxation is fitted beside either."""
    plain = hold(brachial(phase()), 1)
    drifting = hold(brachial(phase()) + 0.3 * np.linspace(-1, 1, COUNT), 1)
    by_drift = train_evidence(drifting, train())
    plainly = train_evidence(plain, train())
    assert by_drift > plainly  # both leave the same; what is left without the fit differs
