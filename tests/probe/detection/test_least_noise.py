"""Relaxing tissue that is read without noise, as a simulated sensor may, is no pulse."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from known_presses import RELAXATION, recording, station

from drivers.core.arrays import Array
from probe.core.recording import Station
from probe.detection import detect
from probe.detection.pulse import fit
from probe.detection.pulse.hold_samples import hold_of
from probe.detection.pulse.least_noise import LEAST_NOISE, least_noise

Relaxing = Callable[[Array, np.random.Generator], Array]


def decays(t: Array, rng: np.random.Generator) -> Array:
    taus = [tau * np.exp(0.3 * rng.normal()) for _, tau in RELAXATION]
    left = sum(g * (1 - np.exp(-t / tau)) for (g, _), tau in zip(RELAXATION, taus, strict=True))
    return np.asarray(1 - rng.uniform(0.3, 1.2) * left)


def a_power(t: Array, rng: np.random.Generator) -> Array:
    return np.asarray((1 + t / rng.uniform(0.1, 0.5)) ** -rng.uniform(0.03, 0.2))


def a_logarithm(t: Array, rng: np.random.Generator) -> Array:
    return np.asarray(1 - rng.uniform(0.01, 0.06) * np.log1p(t / rng.uniform(0.1, 0.5)))


def relaxing(how: Relaxing, seed: int, hold_s: float, noise_pa: float = 0.0) -> Station:
    """Station number ``seed``: the least noise is drawn by that."""
    rng = np.random.default_rng(seed)
    one = station(rng, noise_pa=noise_pa, relaxing=0.0, hold_s=hold_s)
    shape = how(one.time_s - one.time_s[0], rng)
    return replace(one, index=seed, signal_pa=one.signal_pa * shape[:, None])


@pytest.mark.parametrize("how", [decays, a_power, a_logarithm])
@pytest.mark.parametrize("hold_s", [0.8, 2.5])
def test_a_relaxation_without_noise_is_no_artery(how: Relaxing, hold_s: float) -> None:
    """Before, twelve of twenty were, by a pulse of a hundred thousandth of the level."""
    said = [detect(recording([relaxing(how, seed, hold_s)])).finding for seed in range(8)]
    assert said.count("artery") <= 1
    assert said.count("nothing") >= 6


@pytest.mark.parametrize("times", [0.0, 0.3, 3.0])
def test_a_hold_has_that_noise_at_least(times: float) -> None:
    """A hold's means are of ten samples."""
    level_pa = 9000.0
    noise_pa = times * LEAST_NOISE * level_pa * np.sqrt(10)
    hold = hold_of(relaxing(a_logarithm, 1, 5.0, noise_pa))
    more = least_noise(hold, 1)
    assert np.array_equal(more.signal_pa, least_noise(hold, 1).signal_pa)
    if times > 1:
        assert more is hold
    else:
        sd_pa = np.std(more.signal_pa - hold.signal_pa)
        wanted = LEAST_NOISE * float(hold.signal_pa.mean()) * np.sqrt(1 - times**2)
        assert sd_pa == pytest.approx(wanted, rel=0.15)


def test_a_fit_that_goes_round_in_circles_is_found_another_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hold = hold_of(relaxing(decays, 2, 5.0, 20.0))
    design = fit.design_of(hold)
    pulse = fit.harmonics(hold.time_s, 1.2, 2)
    usual = fit.fit(hold, design, pulse)

    def circles(_columns: Array, _y: Array) -> None:
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr(fit, "nnls", circles)
    other = fit.fit(hold, design, pulse)
    np.testing.assert_allclose(other.residual_pa, usual.residual_pa, atol=1e-3)
