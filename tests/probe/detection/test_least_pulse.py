"""What a hold is said to show it shows, and a quarter of it mostly not."""

import numpy as np
import pytest
from known_presses import station

from probe.detection.pulse.hold_samples import hold_of
from probe.detection.pulse.least_pulse import least_pulse_pa
from probe.detection.pulse.search import Search, search

CHANCE = 0.01


@pytest.mark.parametrize(
    ("hold_s", "sample_hz", "tremor_pa"), [(0.9, 50.0, 0.0), (2.5, 50.0, 30.0), (5.0, 50.0, 0.0)]
)
def test_most_holds_show_it(hold_s: float, sample_hz: float, tremor_pa: float) -> None:
    """Nine of ten by its formula, of pulses of the known shape at hearts' usual rates; in 0.9 s,
    where a walk explains much, 63 % of 300."""
    rng = np.random.default_rng(int(10 * hold_s))

    def found(pulse_pa: float) -> Search:
        one = station(rng, pulse_pa=pulse_pa, rate_hz=float(rng.uniform(1.0, 1.45)), noise_pa=10.0,
                      hold_s=hold_s, sample_hz=sample_hz)  # fmt: skip
        turns = np.cumsum(7.5 + rng.standard_normal(len(one.time_s))) / sample_hz
        one.signal_pa[:, 0] += tremor_pa * np.cos(2 * np.pi * turns + rng.uniform(0, 6))
        return search(hold_of(one))[0]

    least_pa = float(np.median([least_pulse_pa(found(0.0), CHANCE) for _ in range(9)]))
    shown = np.mean([found(least_pa).p_value <= CHANCE for _ in range(40)])
    quarter = np.mean([found(least_pa / 4).p_value <= CHANCE for _ in range(40)])
    assert shown > 0.55
    assert (
        quarter < 0.5
    )  # of tremor alone a fifth passes the search, which other causes then explain
