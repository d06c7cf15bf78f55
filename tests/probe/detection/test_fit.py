"""The joint fit of a hold, against what must hold of any least squares."""

import numpy as np
import pytest
from known_presses import station

from probe.detection.pulse.fit import design_of, fit, harmonics
from probe.detection.pulse.hold_samples import Hold, hold_of
from probe.detection.pulse.noise import family


def relaxing(seed: int) -> Hold:
    return hold_of(station(np.random.default_rng(seed), pulse_pa=200.0, noise_pa=20.0))


@pytest.mark.parametrize("seed", range(4))
def test_the_mean_of_all_is_known_as_well_as_the_samples_mean(seed: int) -> None:
    """Whatever decays it is made of: a level is among the columns, and leaves nothing of it."""
    hold = relaxing(seed)
    found = fit(hold, design_of(hold), np.empty((len(hold.time_s), 0)))
    assert len(found.decays)
    assert found.rest_pa.mean() == pytest.approx(hold.signal_pa.mean(), rel=1e-9)
    assert found.rest_mean_sd_pa == pytest.approx(
        found.noise_pa / np.sqrt(len(hold.time_s)), rel=1e-3
    )


@pytest.mark.parametrize("noise", range(0, 12, 3))
def test_no_other_coefficients_leave_less(noise: int) -> None:
    """In coloured noise and with a prior: the sum of squares grows in all directions."""
    hold = relaxing(7)
    design, columns = design_of(hold), harmonics(hold.time_s, 1.2, 3)
    member, ridge = family(hold.step_s, hold.averaged_s)[noise], np.full(6, 0.5)
    found = fit(hold, design, columns, member, ridge)

    def left(pulse: np.ndarray, rest_pa: np.ndarray) -> float:
        white = member.whiten(np.sqrt(hold.weight) * (hold.signal_pa - rest_pa - columns @ pulse))
        return float(white @ white + ((ridge * pulse) ** 2).sum())

    own = found.coefficients[2:]
    assert left(own, found.rest_pa) == pytest.approx(found.rss, rel=1e-6)
    for step in np.concatenate([np.eye(6), -np.eye(6)]):
        assert left(own + step, found.rest_pa) > found.rss
    for column in design.drift.T:
        for step in (-1.0, 1.0):
            assert left(own, found.rest_pa + step * column) > found.rss
    for column in design.decays.T:
        assert left(own, found.rest_pa + column) > found.rss - 1e-6 * found.rss
