"""Sums over trains of beats, against all trains written out."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from probe.detection.pulse.beat_train import GRID_S, _best, _Places, _places, _total

Train = list[tuple[int, int]]


def trains(p: _Places, begun: Train) -> Iterator[Train]:
    """All trains that go on from ``begun``, as starts and lengths in ``p`` to the hold's end."""
    start, length = begun[-1]
    over = start + int(p.lengths[length])
    if p.starts[start] + p.lengths[length] >= p.end:
        yield begun
    elif over >= p.lengths[-1] + 1:  # earlier ones are first beats
        for k in range(len(p.lengths)):
            yield from trains(p, [*begun, (over, k)])


@settings(max_examples=4, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([12, 19]))
def test_all_trains_are_summed_and_the_best_is_found(seed: int, samples: int) -> None:
    p = _places(samples, GRID_S)
    ratio = 3.0 * np.random.default_rng(seed).standard_normal((2, len(p.lengths), len(p.starts)))
    firsts = range(int(p.lengths[-1]) + 1)
    every = [
        train
        for start in firsts for k in range(len(p.lengths))
        for train in trains(p, [(start, k)])
    ]  # fmt: skip
    for m in range(2):
        chance = np.array([
            sum(ratio[m, k, s] + p.log_prior[k] for s, k in train) - np.log(len(firsts))
            for train in every
        ])  # fmt: skip
        assert _total(ratio, p)[m] == pytest.approx(np.logaddexp.reduce(chance), abs=1e-9)
        assert _best(ratio, p)[m] == every[int(np.argmax(chance))]
