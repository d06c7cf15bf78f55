"""Hearts that beat out of time: the interval of the mean rate holds it all the same."""

from collections.abc import Callable

import numpy as np
import pytest

from calibration import HeartCalibration, fit_heart
from calibration.errors import CalibrationError

USUAL_S = 0.8
TIME_S = np.arange(0, 30, 0.01)
Rng = np.random.Generator


def steady(rng: Rng) -> np.ndarray:
    return np.asarray(USUAL_S * (1 + 0.03 * rng.standard_normal(60)))


def fibrillating(rng: Rng) -> np.ndarray:
    """RR intervals of 20 %, as in atrial fibrillation."""
    return np.asarray(USUAL_S * np.maximum(1 + 0.2 * rng.standard_normal(80), 0.45))


def ectopic(rng: Rng) -> np.ndarray:
    """One beat of ten comes early, and the next after a pause."""
    pairs = [[0.65, 1.35] if rng.random() < 0.1 else [1.0] for _ in range(60)]
    beats = np.concatenate(pairs)
    return np.asarray(USUAL_S * (beats + 0.02 * rng.standard_normal(len(beats))))


def breathing(rng: Rng) -> np.ndarray:
    """Six per cent faster and slower with each breath of 4 s."""
    phase = 2 * np.pi * (0.2 * np.arange(60) + rng.random())
    return np.asarray(USUAL_S * (1 + 0.06 * np.sin(phase) + 0.01 * rng.standard_normal(60)))


def found(rng: Rng, lengths: np.ndarray, noise: float = 0.02) -> tuple[HeartCalibration, float]:
    """What is fitted to 30 s of a pressure, and the mean rate of its beats."""
    feet = np.cumsum(lengths) - 2 * USUAL_S
    wave = noise * rng.standard_normal(len(TIME_S))
    for foot in feet:
        since = (TIME_S - foot) / USUAL_S
        wave += np.exp(-(((since - 0.18) / 0.1) ** 2)) + 0.45 * np.exp(
            -(((since - 0.45) / 0.13) ** 2)
        )
    seen = feet[(feet > 0) & (feet < TIME_S[-1])]
    return fit_heart(TIME_S, wave, (120, 80), is_pressure=True), 60 / float(np.diff(seen).mean())


@pytest.mark.parametrize(
    ("rhythm", "least"), [(steady, 0.92), (fibrillating, 0.9), (ectopic, 0.92), (breathing, 0.92)]
)
def test_the_interval_holds_the_mean_rate(
    rhythm: Callable[[Rng], np.ndarray], least: float
) -> None:
    rng, usual, recorded = np.random.default_rng(1), [], []
    for _ in range(100):
        try:
            heart, mean_bpm = found(rng, rhythm(rng))
        except CalibrationError as error:  # one of six that fibrillate
            assert "no steady beat" in str(error)
            continue
        low, high = heart.fit.interval()[0]
        usual.append(low <= 60 / USUAL_S <= high)
        recorded.append(low <= mean_bpm <= high)
    assert len(usual) > 70
    assert np.mean(usual) >= least
    assert np.mean(recorded) >= 0.95


def test_noise_makes_no_beats() -> None:
    rng = np.random.default_rng(2)
    off = []
    for _ in range(40):
        heart, mean_bpm = found(rng, steady(rng), noise=0.3)
        off.append(abs(heart.rate_bpm / mean_bpm - 1))
    assert np.mean(off) < 0.05


def test_the_scatter_of_beats_is_what_they_have() -> None:
    rng = np.random.default_rng(3)
    heart, _ = found(rng, fibrillating(rng))
    assert heart.rr_sd_s == pytest.approx(0.2 * USUAL_S, rel=0.25)
