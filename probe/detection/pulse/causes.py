"""The cause of a movement in a hold: a pulse, or breathing, a machine's line, motion, tremor.

Each is a model of the same hold with an evidence of its own, so that what passes as a pulse is
judged by its shape: a fast rise and a slow fall again and again, and nothing slower beneath.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from drivers.core.arrays import Array
from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.detection.pulse.beat_train import MEMORIES, BeatTrain, Coarse, beat_train, whiten
from probe.detection.pulse.beside_breathing import (
    BESIDE_MEMORIES,
    BREATHING_HZ,
    beside_breathing,
)
from probe.detection.pulse.fit import Fit, design_of
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import family
from probe.detection.pulse.periodic import beside_of, log_evidence, mean_wave, periodic
from probe.detection.pulse.possible_rates import FASTEST_HZ, SLOWEST_HZ, weights
from probe.detection.pulse.search import SHARE
from probe.detection.pulse.train_evidence import SAMPLES_EACH, train_evidence

COARSE_S = 0.04
"""Samples closer than half of this are averaged in pairs: a beat's rise takes twice as long."""
LONGEST_S = 20.0
"""Of a longer hold the first part is asked: what beat trains keep grows with the square of the
samples, 0.9 GB at 30 s, and twenty beats show what moves."""
LINE_HZ = (0.3, 12.0)
"""Up to the fastest tremor of a hand (8 to 12 Hz; Elble & Koller 1990): a third of 5.8 Hz is a
heart's rate, and without a line there 3 of 24 tremors of 4 to 12 Hz were an artery."""
BREATHING_HARMONICS = (1, 2, 6)
"""Of a breath by itself: a faint one shows fewer, and each unknown costs."""
MOTION_S = (0.1, 0.2, 0.4, 0.8)
"""Standard deviations of a bump: a hand that shifts, a swallow, a cough."""
MOVEMENTS, MOVEMENT_UNKNOWNS = 5, 3
MIN_POSTERIOR = 0.8
"""Least posterior probability of a pulse, among all causes, to count as one: four to one. Of 200
pulses of 1 % in 5 s (benchmarks/pulses.py) it finds 194, with 0.75 it is 195; with 0.85 two fewer
of 3 % in 2.5 s were found. Of 400 steady lines at 10 Hz (benchmarks/artefacts.py) 3 were called a
pulse, with 0.85 it was 2, with 0.75 and 0.7 it was 7."""
STEADY_HARMONICS = (2, 8)
"""Of a pulse that is taken as any harmonics at one rate: a loud steady one is known better than the
grid on which beats begin."""


def least_posterior(false_alarm: float) -> float:
    """`MIN_POSTERIOR`, or less where more false pulses are asked for than by default: the odds at
    which a decision changes are what a false one costs over what a missed one does, so that they
    fall as the chance rises (Neyman & Pearson 1933), to even ones."""
    odds = MIN_POSTERIOR / (1 - MIN_POSTERIOR) * min(1.0, DEFAULT_FALSE_ALARM / false_alarm)
    return max(odds, 1.0) / (1 + max(odds, 1.0))


@dataclass(frozen=True)
class Cause:
    """Posterior probability (by name) of what moves in a hold."""

    share: dict[str, float]

    @property
    def pulse(self) -> float:
        return self.share["pulse"]

    @property
    def is_pulse(self) -> bool:
        """Whether it counts as a pulse by default; what neither is nor is none is undecided."""
        return self.pulse >= MIN_POSTERIOR

    @property
    def is_no_pulse(self) -> bool:
        """Whether it is as surely something else."""
        return self.pulse < 1 - MIN_POSTERIOR

    @property
    def rival(self) -> str:
        """The likeliest cause but a pulse."""
        return max((name for name in self.share if name != "pulse"), key=lambda k: self.share[k])


def coarse_of(hold: Hold, null: Fit, longest_s: float = LONGEST_S) -> Coarse:
    """A hold without relaxation and drift, at `COARSE_S` or what it has, up to ``longest_s``."""
    design = design_of(hold)
    nuisance = np.hstack([design.drift, design.decays[:, null.decays]])
    q, _ = np.linalg.qr(nuisance)
    signal = null.residual_pa - q @ (q.T @ null.residual_pa)
    fold = max(1, round(COARSE_S / max(hold.step_s, 1e-9)))
    kept = int(min(len(signal), np.round(longest_s / max(hold.step_s, 1e-9)))) // fold * fold

    def folded(columns: Array) -> Array:
        return np.asarray(columns[:kept].reshape(-1, fold, *columns.shape[1:]).mean(axis=1))

    return Coarse(folded(signal), round(fold * hold.step_s, 4), folded(nuisance))


def chance_without_pulse(hold: Coarse, train: BeatTrain) -> float:
    """How often a hold without a pulse makes a train of beats as likely as this one, at most: the
    evidence ratio against the family of noises (Markov's inequality; Ville 1939)."""
    n, evidences = len(hold.signal), []
    for noise in family(hold.step_s):
        q, _ = np.linalg.qr(noise.whiten(hold.nuisance))
        y = noise.whiten(hold.signal)
        evidences.append(-0.5 * n * np.log(max(float(y @ y - ((q.T @ y) ** 2).sum()), 1e-300) / n))
    without = float(np.logaddexp.reduce(evidences)) - np.log(len(evidences)) - 0.5 * n
    return float(np.exp(min(without - train.log_evidence, 0.0)))


def evidence_of(hold: Coarse, train: BeatTrain) -> dict[str, float]:
    """Log evidence of each of `MOVERS`, and of "uneven beats" as a part of a pulse's.

    Where a pulse is not sure, each but breathing is also judged `beside_breathing`, which takes as
    long again: whether somebody breathes does not depend on what else moves.
    """
    evidence = {name: mover.evidence(hold, MEMORIES) for name, mover in MOVERS.items()}
    own = float(np.log(SHARE["train"]) + train_evidence(hold, train))
    evidence |= {"pulse": float(np.logaddexp(evidence["pulse"], own)), "uneven beats": own}
    if cause_of([evidence]).is_pulse:
        return evidence
    still, cost = beside_breathing(hold, SLOWEST_HZ, FASTEST_HZ)
    chance = MOVERS["breathing"].prior
    for name in MOVERS.keys() - {"breathing"}:
        beside_breath = MOVERS[name].evidence(still, BESIDE_MEMORIES) - cost
        evidence[name] = float(
            np.logaddexp(np.log1p(-chance) + evidence[name], np.log(chance) + beside_breath)
        )
    return evidence


def _steady_pulse(hold: Coarse, memories: Sequence[float]) -> float:
    """The mean wave, or any harmonics, times its share."""
    return float(np.logaddexp.reduce([
        np.log(SHARE["shaped"]) + mean_wave(hold, SLOWEST_HZ, FASTEST_HZ, memories),
        *(np.log(SHARE["free"] / len(STEADY_HARMONICS))
          + periodic(hold, SLOWEST_HZ, FASTEST_HZ, count, weights, memories)
          for count in STEADY_HARMONICS),
    ]))  # fmt: skip


def _breathing(hold: Coarse, memories: Sequence[float]) -> float:
    evidence = [
        periodic(hold, *BREATHING_HZ, count, memories=memories) for count in BREATHING_HARMONICS
    ]
    return float(np.logaddexp.reduce(evidence) - np.log(len(BREATHING_HARMONICS)))


def _line(hold: Coarse, memories: Sequence[float]) -> float:
    return periodic(hold, *LINE_HZ, 1, memories=memories)


def cause_of(evidences: Sequence[dict[str, float]]) -> Cause:
    """What moves in holds that all have the same cause."""
    score = np.array([
        np.log(mover.prior) + sum(each[name] for each in evidences)
        for name, mover in MOVERS.items()
    ])  # fmt: skip
    share = np.exp(score - np.logaddexp.reduce(score))
    return Cause(dict(zip(MOVERS, share.tolist(), strict=True)))


def _tremor(hold: Coarse, _memories: Sequence[float]) -> float:
    return train_evidence(hold, beat_train(hold, "symmetric"))


def _motion(hold: Coarse, _memories: Sequence[float]) -> float:
    """Evidence of a few steps and bumps at any time, chosen one after the other.

    Each number of them is as likely beforehand.
    """
    evidence = -np.inf
    for memory in MEMORIES:
        nuisance, y = beside_of(hold, memory)
        c = _movements(len(hold.signal), hold.step_s, memory)
        along = nuisance.T @ c
        square = np.maximum((c * c).sum(axis=0) - (along * along).sum(axis=0), 1e-12)
        total = len(y) - (memory == 1.0)
        taken = nuisance
        most = max(1, min(MOVEMENTS, int(total / SAMPLES_EACH / MOVEMENT_UNKNOWNS)))
        evidences = []
        for k in range(1, most + 1):
            best = int(np.argmax((y @ c) ** 2 / square * (square > 1e-6)))
            column = c[:, best] - taken @ (taken.T @ c[:, best])
            column = column / max(float(np.linalg.norm(column)), 1e-12)
            square = np.maximum(square - (column @ c) ** 2, 1e-12)
            y = y - column * (column @ y)
            taken = np.column_stack([taken, column])
            choice = k * np.log(c.shape[1] / 4)
            evidences.append(float(log_evidence(y @ y, total, k)) - choice)
        evidence = max(evidence, float(np.logaddexp.reduce(evidences) - np.log(most)))
    return evidence


@lru_cache(maxsize=6)
def _movements(n: int, step_s: float, memory: float) -> Array:
    """Whitened steps and bumps (n, m) at every time."""
    time_s = np.arange(n) * step_s
    steps = (time_s[:, None] > time_s[None, :-1]).astype(float)
    bumps = [np.exp(-0.5 * ((time_s[:, None] - time_s) / sd) ** 2) for sd in MOTION_S]
    return whiten(np.hstack([shapes - shapes.mean(axis=0) for shapes in (steps, *bumps)]), memory)


@dataclass(frozen=True)
class Mover:
    """What may move in a hold: its ``prior``, its log ``evidence`` in noises of some memories (the
    best fit's `log_evidence`, less the log of how many were tried), and what to do about it."""

    prior: float
    evidence: Callable[[Coarse, Sequence[float]], float]
    advice: str


MOVERS: Mapping[str, Mover] = {
    "pulse": Mover(0.6, _steady_pulse, ""),
    "breathing": Mover(0.1, _breathing, "let the breath be held for one hold"),
    "a steady line": Mover(0.1, _line, "switch the machine off or record a reference (PPG or ECG)"),
    "motion": Mover(0.1, _motion, "repeat the press without moving"),
    "tremor": Mover(0.1, _tremor, "support the probe or sample faster"),
}
"""By name. Before the hold is looked at a pulse is what a scan looks for, and nothing is known of
the others; the priors add up to 1. A choice, which acts together with `MIN_POSTERIOR`: how much it
matters is said there."""
