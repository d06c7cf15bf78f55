"""A pulse as a train of beats whose times are unknown: a renewal process of one arterial wave.

Atrial fibrillation and ectopic beats have no rate that a search over rates could find. Here every
beat has its own length and size: the hold's likelihood is summed over all sequences of beats by the
forward algorithm of a hidden semi-Markov model (Rabiner 1989, section IV.D), and the best sequence
is Viterbi's. Regularity is not asked for; the prior of a beat's length is log-uniform.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.core.arrays import Array, Ints
from probe.detection.pulse.wave import brachial

Form = Literal["arterial", "symmetric"]

SHORTEST_S, LONGEST_S = 1 / 3, 1.5
"""Beats from 180 to 40 a minute."""
GRID_S = 0.04
"""Beats begin on this grid, or on half samples where samples are further apart."""
UNEQUAL = 0.3
"""Standard deviation of a beat's size over the mean: a choice. It matters: of 24 holds of 5 s (8 of
noise, 16 of beats of 0.4 to 1.2 s whose size varies by a quarter, as large as the noise or three
times as large) half of it changes the log evidence by up to 5.3, twice of it by up to 3.5."""
MEMORIES = (0.0, 0.7, 1.0)
"""Noise of the train: first-order autoregressions from white to a random walk."""
ROUNDS = 4
"""Of size and noise in turns with the best train: eight change those holds' by at most 1.0."""
START_PERCENTILES, START_NOISE = (3, 97), 0.3
"""Where the rounds begin: the swing between these percentiles, and noise of this share of the
power. Half or twice of either changes those holds' log evidence by at most 1.0, mostly by 0.2."""
MIN_FREE = 8.0
"""Samples that the noise's level is at least found from: half or twice of it changes nothing."""


@dataclass(frozen=True, eq=False)
class Coarse:
    """A hold without relaxation and drift: ``signal`` (n,), ``step_s`` apart. ``nuisance`` (n, k)
    are the columns that were taken out. Two are equal only if they are the same one."""

    signal: Array
    step_s: float
    nuisance: Array


@dataclass(frozen=True)
class BeatTrain:
    """``log_evidence`` of the hold given some train of beats of a ``form``; the likeliest one
    ``begins_s`` (b,) with ``lengths_s`` (b,) and sizes ``swing_pa`` (b,)."""

    log_evidence: float
    begins_s: Array
    lengths_s: Array
    swing_pa: Array
    form: Form = "arterial"

    def beats_at(self, time_s: Array) -> tuple[Array, Array]:
        """Of the beats at times (n,): the phase (n,) since its foot, and its size (n,)."""
        last = len(self.begins_s) - 1
        beat = np.clip(np.searchsorted(self.begins_s, time_s + 1e-9, "right") - 1, 0, last)
        return (time_s - self.begins_s[beat]) / self.lengths_s[beat], self.swing_pa[beat]

    def wave(self, phase: Array, swing_pa: Array) -> Array:
        """Beats (n,) of a size at phases (n,)."""
        return swing_pa * _wave(self.form, phase)


def _wave(form: Form, phase: Array) -> Array:
    """A beat of a swing of 1, without its mean."""
    return brachial(phase) if form == "arterial" else -0.5 * np.cos(2 * np.pi * phase)


def beat_train(hold: Coarse, form: Form = "arterial") -> BeatTrain:
    """Sum over all trains of beats of a ``form``, for the likeliest noise.

    The mean size and the noise's level are those of the best train, found in turns with it; two
    unknowns cost log n (Schwarz 1978).
    """
    n = len(hold.signal)
    places = _places(n, hold.step_s)
    whole = [_dictionary(n, hold.step_s, form, memory) for memory in MEMORIES]
    white = [whiten(hold.signal, memory) for memory in MEMORIES]
    count = np.array([n - (memory == 1.0) for memory in MEMORIES], float)
    power = np.array([e @ e for e in white])
    along = np.array([w @ e.astype(np.float32) for (w, _), e in zip(whole, white, strict=True)])
    square = np.array([s for _, s in whole])
    size = np.full(len(MEMORIES), float(np.ptp(np.percentile(hold.signal, START_PERCENTILES))))
    variance = np.maximum(START_NOISE * power / count, 1e-300)
    for _ in range(ROUNDS):
        ratio, mean, _ = _each_beat(along, square, size, variance)
        paths = _best(ratio, places)
        for m, path in enumerate(paths):
            swings = np.array([mean[m][k, i] for i, k in path])
            wave = np.sum([a * whole[m][0][k, i] for a, (i, k) in zip(swings, path, strict=True)],
                          axis=0)  # fmt: skip
            left = max(float(((white[m] - wave) ** 2).sum()), 1e-9 * power[m], 1e-300)
            variance[m] = left / max(count[m] - len(path), MIN_FREE)
            size[m] = max(float(swings.mean()), 1e-9 * float(np.abs(hold.signal).max()), 1e-300)
    ratio, mean, _ = _each_beat(along, square, size, variance)
    evidence = (
        _total(ratio, places) - 0.5 * count * np.log(variance) - 0.5 * power / variance - np.log(n)
    )
    best = int(np.argmax(evidence))
    begins = np.array([places.starts[i] for i, _ in paths[best]]) * places.grid_s
    lengths = np.array([places.lengths[k] for _, k in paths[best]]) * places.grid_s
    swings = np.array([mean[best][k, i] for i, k in paths[best]])
    return BeatTrain(float(evidence[best]), begins, lengths, swings, form)


def whiten(columns: Array, memory: float) -> Array:
    """Innovations (n, ...) of a first-order autoregression; the first is left out at 1."""
    white = columns.astype(float, copy=True)
    white[1:] -= memory * columns[:-1]
    white[0] *= np.sqrt(1 - memory**2)
    return white


@dataclass(frozen=True)
class _Places:
    """Where beats may begin and how long they may last, in steps of ``grid_s``."""

    grid_s: float
    lengths: Ints
    starts: Ints
    end: int
    log_prior: Array


@lru_cache(maxsize=8)
def _places(n: int, step_s: float) -> _Places:
    grid = GRID_S if step_s <= GRID_S else step_s / 2
    lengths = np.arange(int(np.ceil(SHORTEST_S / grid)), int(LONGEST_S / grid) + 1)
    end = int(np.ceil((n - 1) * step_s / grid)) + 1
    prior = -np.log(lengths)
    prior -= np.logaddexp.reduce(prior)
    return _Places(grid, lengths, np.arange(-lengths[-1], end), end, prior)


@lru_cache(maxsize=12)
def _dictionary(
    n: int, step_s: float, form: Form, memory: float
) -> tuple[NDArray[np.float32], Array]:
    """Whitened beats (lengths, starts, n) of a swing of 1, and their squares."""
    p = _places(n, step_s)
    since = np.arange(n) * step_s - p.starts[:, None] * p.grid_s
    phase = since[None] / (p.lengths[:, None, None] * p.grid_s)
    inside = (phase >= 0) & (phase < 1)
    beats = np.zeros(phase.shape)
    within = phase[inside]
    beats[inside] = _wave(form, within)
    white = np.moveaxis(whiten(np.moveaxis(beats, -1, 0), memory), 0, -1).astype(np.float32)
    return white, np.einsum("kin,kin->ki", white, white).astype(float)


def _each_beat(
    along: Array, square: Array, size: Array, variance: Array
) -> tuple[Array, Array, Array]:
    """Log likelihood ratio of each beat (m, lengths, starts), its size's mean and variance.

    A size is normal about ``size`` (m,) with `UNEQUAL` beforehand.
    """
    a, v = size[:, None, None], (UNEQUAL * size[:, None, None]) ** 2
    b, g = along / variance[:, None, None], square / variance[:, None, None]
    spread = 1 / (1 / v + g)
    mean = (a / v + b) * spread
    return -0.5 * np.log1p(v * g) + 0.5 * (mean**2 / spread - a * a / v), mean, spread


def _arriving(scores: Array, p: _Places) -> tuple[Array, Ints]:
    """Scores of the beats that end at each start (s, m, k), -inf before the first may, and where
    they began (s, k)."""
    at = np.arange(len(p.starts))[:, None] - p.lengths
    began = np.maximum(at, 0)
    ending = np.moveaxis(scores, 0, 2)[np.arange(len(p.lengths)), began].transpose(0, 2, 1)
    return np.where(at[:, None, :] >= 0, ending, -np.inf), began


def _open(p: _Places, m: int) -> Array:
    """Log chance (m, s) that a beat begins at a start: uniform over the first `LONGEST_S`, and -inf
    after it, which the recursion fills in."""
    open_ = np.full((m, len(p.starts)), -np.inf)
    open_[:, : p.lengths[-1] + 1] = -np.log(p.lengths[-1] + 1.0)
    return open_


def _blocks(p: _Places) -> Iterator[slice]:
    """Starts whose beats before them all begin in earlier blocks: no beat is shorter than one."""
    block = int(p.lengths[0])
    for first in range(int(p.lengths[-1]) + 1, len(p.starts), block):
        yield slice(first, min(first + block, len(p.starts)))


def _last(open_: Array, scores: Array, p: _Places) -> Array:
    """Scores (m, k s) of the beats that are the hold's last, -inf for all else."""
    lasting = p.starts[None] + p.lengths[:, None] >= p.end
    return np.where(lasting, open_[:, None, :] + scores, -np.inf).reshape(len(scores), -1)


def _total(ratio: Array, p: _Places) -> Array:
    """Log of the sum over all trains (m,)."""
    scores = ratio + p.log_prior[:, None]
    arriving, began = _arriving(scores, p)
    open_ = _open(p, len(ratio))
    for now in _blocks(p):
        each = np.moveaxis(open_[:, began[now]], 0, 1) + arriving[now]
        open_[:, now] = _log_sum(each).T
    return _log_sum(_last(open_, scores, p))


def _log_sum(each: Array) -> Array:
    """Logarithm of the sum of exponentials over the last axis, none of which is all -inf."""
    top = each.max(axis=-1)
    return np.asarray(top + np.log(np.exp(each - top[..., None]).sum(axis=-1)))


def _best(ratio: Array, p: _Places) -> list[list[tuple[int, int]]]:
    """The likeliest train of each noise: (start, length) of its beats, as places in ``p``."""
    scores = ratio + p.log_prior[:, None]
    arriving, began = _arriving(scores, p)
    open_ = _open(p, len(ratio))
    came = np.full(open_.shape, -1)
    for now in _blocks(p):
        each = np.moveaxis(open_[:, began[now]], 0, 1) + arriving[now]
        came[:, now] = each.argmax(axis=2).T
        open_[:, now] = each.max(axis=2).T
    paths = []
    for m, last in enumerate(_last(open_, scores, p)):
        length, start = divmod(int(np.argmax(last)), len(p.starts))
        path = [(start, length)]
        while (before := int(came[m, path[0][0]])) >= 0:
            path.insert(0, (path[0][0] - int(p.lengths[before]), before))
        paths.append(path)
    return paths
