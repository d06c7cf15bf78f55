"""What else could have made a pulse: breathing, a machine's line, motion, tremor.

Each is a model of the same hold with an evidence of its own, so that what passes as a pulse is
judged by its shape: a fast rise and a slow fall again and again, and nothing slower beneath.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import logsumexp

from drivers.core.arrays import Array, Bools, Ints
from probe.detection.pulse.beat_train import MEMORIES, BeatTrain, Coarse, beat_train, whiten
from probe.detection.pulse.fit import Fit, design_of
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.noise import family
from probe.detection.pulse.own_shape import NYQUIST_SHARE, SAMPLES_EACH, shape_evidence
from probe.detection.pulse.search import FASTEST_HZ, SLOWEST_HZ

COARSE_S = 0.04
"""Samples closer than half of this are averaged in pairs: a beat's rise takes twice as long."""
LINE_HZ = (0.3, 5.0)
BREATHING_HZ, BREATHING_HARMONICS = (0.1, 0.6), 6
"""6 to 36 breaths a minute."""
MOTION_S = (0.1, 0.2, 0.4, 0.8)
"""Standard deviations of a bump: a hand that shifts, a swallow, a cough."""
MOVEMENTS, MOVEMENT_UNKNOWNS = 5, 3
PRIOR = {"pulse": 0.6, "breathing": 0.1, "a steady line": 0.1, "motion": 0.1, "tremor": 0.1}
"""Before the hold is looked at: a pulse is what a scan looks for, nothing is known of the others. A
choice; how much it matters has not been measured."""
REFINED = 3
"""Rounds of narrowing a rate, each to a quarter: a strong line must be met within its doubt."""
OWN_HARMONICS = 6
"""Harmonics in which a person's wave may differ from the mean one; the brachial wave's further ones
are below 0.08 of its first."""
STEADY, STEADY_HARMONICS = 0.1, (2, 8)
"""Share of pulses that are taken as any harmonics at one rate instead of a train of arterial waves,
and how many: a loud steady pulse is known better than the grid on which beats begin."""


@dataclass(frozen=True)
class Cause:
    """Posterior probability (by name) of what moves in a hold."""

    share: dict[str, float]

    @property
    def pulse(self) -> float:
        return self.share["pulse"]

    @property
    def rival(self) -> str:
        """The likeliest cause but a pulse."""
        return max((name for name in self.share if name != "pulse"), key=lambda k: self.share[k])


def coarse_of(hold: Hold, null: Fit) -> Coarse:
    """A hold without relaxation and drift, at `COARSE_S` or what it has."""
    design = design_of(hold)
    nuisance = np.hstack([design.drift, design.decays[:, null.decays]])
    q, _ = np.linalg.qr(nuisance)
    signal = null.residual_pa - q @ (q.T @ null.residual_pa)
    fold = max(1, round(COARSE_S / max(hold.step_s, 1e-9)))
    kept = len(signal) // fold * fold

    def folded(columns: Array) -> Array:
        return np.asarray(columns[:kept].reshape(-1, fold, *columns.shape[1:]).mean(axis=1))

    return Coarse(folded(signal), round(fold * hold.step_s, 4), folded(nuisance))


def chance_without_pulse(hold: Coarse, train: BeatTrain) -> float:
    """How often a hold without a pulse makes a train of beats as likely as this one, at most: the
    evidence ratio against the family of noises (Markov's inequality; Ville 1939)."""
    n, found = len(hold.signal), []
    for noise in family(hold.step_s):
        q, _ = np.linalg.qr(noise.whiten(hold.nuisance))
        y = noise.whiten(hold.signal)
        found.append(-0.5 * n * np.log(max(float(y @ y - ((q.T @ y) ** 2).sum()), 1e-300) / n))
    without = float(logsumexp(found)) - np.log(len(found)) - 0.5 * n
    return float(np.exp(min(without - train.log_evidence, 0.0)))


def evidence_of(hold: Coarse, train: BeatTrain) -> dict[str, float]:
    """Log evidence of each cause that `PRIOR` names."""
    return {
        "pulse": float(logsumexp([
            np.log(1 - STEADY) + shape_evidence(hold, train, OWN_HARMONICS),
            *(np.log(STEADY / len(STEADY_HARMONICS))
              + _periodic(hold, SLOWEST_HZ, FASTEST_HZ, count) for count in STEADY_HARMONICS),
        ])),
        "breathing": _periodic(hold, *BREATHING_HZ, BREATHING_HARMONICS),
        "a steady line": _periodic(hold, *LINE_HZ, 1),
        "motion": _motion(hold),
        "tremor": shape_evidence(hold, beat_train(hold, "symmetric"), 0),
    }  # fmt: skip


def cause_of(evidences: Sequence[dict[str, float]]) -> Cause:
    """What moves in holds that all have the same cause."""
    score = np.array([np.log(p) + sum(e[name] for e in evidences) for name, p in PRIOR.items()])
    share = np.exp(score - logsumexp(score))
    return Cause(dict(zip(PRIOR, share.tolist(), strict=True)))


def _log_evidence(left: Array, n: int, unknowns: int | Ints) -> Array:
    """Of a linear model by what it leaves of the hold (Schwarz 1978)."""
    return np.asarray(-0.5 * n * np.log(np.maximum(left, 1e-300) / n) - 0.5 * n
                      - 0.5 * (unknowns + 2) * np.log(n))  # fmt: skip


def _periodic(hold: Coarse, slowest_hz: float, fastest_hz: float, count: int) -> float:
    """Evidence of up to ``count`` harmonics at one unknown rate, the first the largest."""
    n = len(hold.signal)
    count = max(1, min(count, int((n / SAMPLES_EACH - 1) / 2)))
    fastest_hz = min(fastest_hz, NYQUIST_SHARE / hold.step_s)
    independent = 1 + (fastest_hz - slowest_hz) * n * hold.step_s
    rates = np.linspace(slowest_hz, fastest_hz, int(4 * independent))
    best, at = -np.inf, (MEMORIES[0], 0)
    for memory in MEMORIES:
        each = _at_rates(hold, rates, count, memory)
        if each.max() > best:
            best, at = float(each.max()), (memory, int(np.argmax(each)))
    memory, k = at
    low, high = rates[max(k - 1, 0)], rates[min(k + 1, len(rates) - 1)]
    for _ in range(REFINED):
        fine = np.linspace(low, high, 9)
        each = _at_rates(hold, fine, count, memory)
        k = int(np.argmax(each))
        best = max(best, float(each[k]))
        low, high = fine[max(k - 1, 0)], fine[min(k + 1, 8)]
    return float(best - np.log(independent))


def _at_rates(hold: Coarse, rates: Array, count: int, memory: float) -> Array:
    """Evidence (r,) of harmonics at each rate; none where the first is not the largest."""
    n = len(hold.signal)
    beside = _beside(hold, memory)
    y = whiten(hold.signal, memory)
    y = y - beside @ (beside.T @ y)
    c, seen = _waves(n, hold.step_s, tuple(rates.tolist()), count, memory)
    c = c - beside @ (beside.T @ c)
    gram = np.swapaxes(c, 1, 2) @ c + 1e-9 * n * np.eye(2 * count)
    right = np.swapaxes(c, 1, 2) @ y
    size = np.linalg.solve(gram, right[..., None])[..., 0]
    left = float(y @ y) - (right * size).sum(axis=1)
    swing = np.hypot(size[:, :count], size[:, count:])
    unknowns = 2 * seen.sum(axis=1)
    found = _log_evidence(left, n - (memory == 1.0), unknowns)
    return np.asarray(np.where(swing.argmax(axis=1) == 0, found, -np.inf))


@lru_cache(maxsize=32)
def _waves(
    n: int, step_s: float, rates: tuple[float, ...], count: int, memory: float
) -> tuple[Array, Bools]:
    """Whitened harmonics (r, n, 2 count) of each rate, and which (r, count) the samples can tell:
    the same for all holds of a scan, but for those of a refined rate."""
    seen = np.outer(rates, np.arange(1, count + 1)) <= max(NYQUIST_SHARE / step_s, rates[0])
    turn = (
        2
        * np.pi
        * (np.arange(n) * step_s)[:, None, None]
        * np.outer(rates, np.arange(1, count + 1))
    )
    waves = np.concatenate([np.cos(turn) * seen, np.sin(turn) * seen], axis=2)
    return np.ascontiguousarray(np.moveaxis(whiten(waves, memory), 0, 1)), seen


def _beside(hold: Coarse, memory: float) -> Array:
    """An orthonormal basis (n, k) of what relaxation and drift could take, whitened."""
    columns = whiten(hold.nuisance, memory)
    u, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, size > 1e-9 * size[0]])


def _motion(hold: Coarse) -> float:
    """Evidence of a few steps and bumps at any time, chosen one after the other."""
    found = []
    for memory in MEMORIES:
        beside = _beside(hold, memory)
        c = _movements(len(hold.signal), hold.step_s, memory)
        y = whiten(hold.signal, memory)
        y, along = y - beside @ (beside.T @ y), beside.T @ c
        square = np.maximum((c * c).sum(axis=0) - (along * along).sum(axis=0), 1e-12)
        total = len(y) - (memory == 1.0)
        taken = beside
        most = min(MOVEMENTS, int(total / SAMPLES_EACH / MOVEMENT_UNKNOWNS))
        for k in range(1, max(most, 1) + 1):
            best = int(np.argmax((y @ c) ** 2 / square * (square > 1e-6)))
            one = c[:, best] - taken @ (taken.T @ c[:, best])
            one = one / max(float(np.linalg.norm(one)), 1e-12)
            square = np.maximum(square - (one @ c) ** 2, 1e-12)
            y = y - one * (one @ y)
            taken = np.column_stack([taken, one])
            choice = k * np.log(c.shape[1] / 4)
            found.append(float(_log_evidence(y @ y, total, k)) - choice)
    return float(max(found))


@lru_cache(maxsize=6)
def _movements(n: int, step_s: float, memory: float) -> Array:
    """Whitened steps and bumps (n, m) at every time."""
    time_s = np.arange(n) * step_s
    steps = (time_s[:, None] > time_s[None, :-1]).astype(float)
    bumps = [np.exp(-0.5 * ((time_s[:, None] - time_s) / sd) ** 2) for sd in MOTION_S]
    return whiten(np.hstack([one - one.mean(axis=0) for one in (steps, *bumps)]), memory)
