"""Hearts that beat unevenly: in fibrillation and with ectopic beats no rate describes a hold.

A wave at one rate takes such a pulse for as little as a fifth of what it is, and the rate for up to
twice the heart's. Where holds show it, their beats are taken as they came.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.beat_train import SHORTEST_S, BeatTrain, Coarse, beat_train
from probe.detection.pulse.causes import LONGEST_S, coarse_of
from probe.detection.pulse.fit import design_of, fit
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.possible_rates import RATE_VARIABILITY
from probe.detection.pulse.size import Rates

UNEVEN = 2 * RATE_VARIABILITY
"""Standard deviation of a hold's beats over their mean length from which its heart is uneven. Of 60
holds of 5 s (fibrillation, ectopic beats, a steady heart in loud noise) the rate's interval holds
it in the same with 0.075, in one less with 0.15; sizes are the same."""
MIN_WHOLE = 3
"""Whole beats whose lengths have a scatter: with fewer a hold says nothing of it."""


@dataclass(frozen=True)
class Beats:
    """``bounds_s`` (b + 1,): where each beat of a hold begins, on the hold's clock, and the last
    ends; ``swing_pa`` (b,) from trough to crest. The first and the last are cut by the hold's ends,
    and count for nothing else."""

    bounds_s: Array
    swing_pa: Array

    @property
    def whole_s(self) -> Array:
        return np.diff(self.bounds_s)[1:-1]

    @property
    def mean_s(self) -> float:
        return float(self.whole_s.mean())

    @property
    def variability(self) -> float:
        """Standard deviation of the beats' lengths over their mean, no less than usual hearts'."""
        return max(float(self.whole_s.std(ddof=1)) / self.mean_s, RATE_VARIABILITY)

    @property
    def size_doubt(self) -> float:
        """Of their mean size, over it: what others of the same heart would differ by."""
        swing_pa = self.swing_pa[1:-1]
        return float(swing_pa.std(ddof=1) / swing_pa.mean() / np.sqrt(len(swing_pa)))

    @property
    def uneven(self) -> bool:
        return len(self.whole_s) >= MIN_WHOLE and self.variability > UNEVEN

    def counted_s(self, time_s: Array) -> Array:
        """Time (n,) [s] as if each beat took the mean one's."""
        counted = np.interp(time_s, self.bounds_s, np.arange(len(self.bounds_s)))
        return np.asarray(counted * self.mean_s)


def mean_rate(uneven: Sequence[Beats]) -> Rates:
    """The mean rate of all whole beats of some holds."""
    lengths = np.concatenate([one.whole_s for one in uneven])
    mean_s = float(lengths.mean())
    return Rates(np.array([1 / mean_s]), float(lengths.std(ddof=1)) / mean_s)


def beats_of(hold: Hold, train: BeatTrain | None = None) -> Beats:
    """A hold's likeliest beats; ``train`` where those of its first `LONGEST_S` are known.

    A longer hold's are found part by part; the beat over a joint begins in the part before it.
    """
    begins: list[tuple[float, float]] = []
    end_s = 0.0
    for start_s, one in _trains(hold, train):
        first_s = max(start_s, begins[-1][0] + SHORTEST_S) if begins else -np.inf
        pairs = zip((start_s + one.begins_s).tolist(), one.swing_pa.tolist(), strict=True)
        begins += [pair for pair in pairs if pair[0] >= first_s]
        end_s = start_s + float(one.begins_s[-1] + one.lengths_s[-1])
    bounds_s = hold.time_s[0] + np.array([*(begin for begin, _ in begins), end_s])
    return Beats(bounds_s, np.array([swing for _, swing in begins]))


def _trains(hold: Hold, train: BeatTrain | None) -> list[tuple[float, BeatTrain]]:
    """When each part of a hold begins, of at most `LONGEST_S`, and its train."""
    if train is not None and hold.span_s <= LONGEST_S:
        return [(0.0, train)]
    null = fit(hold, design_of(hold), np.empty((len(hold.time_s), 0)))
    whole = coarse_of(hold, null, np.inf)
    parts = np.array_split(np.arange(len(whole.signal)), int(np.ceil(hold.span_s / LONGEST_S)))
    return [
        (float(one[0] * whole.step_s),
         beat_train(Coarse(whole.signal[one], whole.step_s, whole.nuisance[one])))
        for one in parts
    ]  # fmt: skip
