"""The subject's heart: rate, its variability and the pressure wave, for a scene's pulse."""

import csv
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, as_columns, ascending, correlated, linear_fit, same_length

RATES_HZ = (0.5, 3.5)  # 30 to 210 beats per minute
PHASES = 128
MAX_STEP_S, GRID_S = 0.05, 0.02  # a wave's 8th harmonic at 70 beats per minute has 9 Hz
NEARER_TO_ONE = 0.5  # of the usual beat: what is off by more is nearer to two beats, or to none
LOOK_BELOW = 0.5  # of the shortest beat: of a faster heart two beats would be taken for one
STEEP = 0.6  # of the usual upstroke; 0.4 took noise of 30 % of the pulse for beats: rates 8 % off
OUTLYING, NORMAL_MEDIAN = 3.0, 0.6745  # in standard deviations: one normal beat of 370; the median
ADVICE = "record at least ten quiet beats with the sensor well seated"


@dataclass(frozen=True)
class HeartCalibration:
    """``rate_bpm``; ``rr_sd_s``, beat-to-beat; ``wave_mmhg`` over one beat, empty if unknown.

    ``wave_mmhg`` (128,) starts at the foot of the beat.
    """

    KIND: ClassVar[str] = "heart"
    UNITS: ClassVar[dict[str, str]] = {
        "rate_bpm": "1/min",
        "rr_sd_s": "s",
        "systolic_mmhg": "mmHg",
        "diastolic_mmhg": "mmHg",
        "wave_mmhg": "mmHg",
    }
    rate_bpm: float
    rr_sd_s: float
    systolic_mmhg: float
    diastolic_mmhg: float
    wave_mmhg: Array
    fit: Fit = field(repr=False)

    def write_wave(self, path: Path) -> None:
        """The wave as the CSV a scene's ``pulse.wave`` takes: time_s, pressure_mmhg."""
        if not len(self.wave_mmhg):
            raise CalibrationError("the wave is not known; record the pressure itself (tonometer)")
        period = 60 / self.rate_bpm
        with path.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(["time_s", "pressure_mmhg"])
            closed = np.append(self.wave_mmhg, self.wave_mmhg[0])
            for n, level in enumerate(closed.tolist()):
                rows.writerow([f"{period * n / PHASES:.6f}", f"{level:.4f}"])


def fit_heart(
    time_s: Array,
    reference: Array,
    cuff_mmhg: tuple[float, float],
    *,
    is_pressure: bool,
) -> HeartCalibration:
    """Rate and wave from a reference channel; ``reference`` (n,) at ``time_s`` (n,).

    ``cuff_mmhg`` (systolic, diastolic) scales the wave. ``is_pressure``: the channel is a
    pressure or force (tonometer); a PPG or ECG gives the rate only, since its shape is not the
    pressure's.

    The mean rate's interval is of all beats that are seen, however irregular, less those nearer to
    two usual beats or to none, with their correlation in time (`correlated`). In 30 s of atrial
    fibrillation (RR 20 %; one of six recordings is refused) it holds the heart's mean rate in 92 %
    of 400 draws, with 10 % of ectopic beats and breathing in 99 % and more. From longer and wilder
    ones (60 s, 25 %) in 80 %: early beats within half a usual one are not seen.

    Raises `CalibrationError` when no steady beat is found, or one outside `RATES_HZ`.
    """
    systolic, diastolic = check_cuff(*cuff_mmhg)
    t, y = as_columns(time_s, "time_s", 1)[:, 0], as_columns(reference, "reference", 1)[:, 0]
    same_length(time_s=t, reference=y)
    ascending("time_s", t)
    if len(t) < 20 or t[-1] - t[0] < 5:
        raise CalibrationError(f"less than 5 s of readings; {ADVICE}")
    if (usual_s := float(np.median(np.diff(t)))) > MAX_STEP_S:
        raise CalibrationError(
            f"{1 / usual_s:.0f} samples/s are too few for a wave; use {1 / MAX_STEP_S:.0f} or more"
        )
    grid = np.arange(t[0], t[-1], step := min(usual_s, GRID_S))
    level = np.interp(grid, t, y)
    feet_s = _feet(grid, level, step)
    rr = np.diff(feet_s)
    usual = float(np.median(rr))
    scatter = float(np.median(np.abs(rr - usual))) / NORMAL_MEDIAN
    good = np.abs(rr - usual) < max(NEARER_TO_ONE * usual, OUTLYING * scatter)
    if good.sum() < 5:
        raise CalibrationError(f"only {int(good.sum())} steady beats found; {ADVICE}")
    mean, sd = float(rr[good].mean()), float(rr[good].std(ddof=1))
    least, most = (60 * rate_hz for rate_hz in RATES_HZ)
    if not least <= 60 / mean <= most:
        raise CalibrationError(
            f"{60 / mean:.0f} beats per minute; {least:g} to {most:g} are possible: is time_s in "
            "seconds, and is the reference channel the heart's?"
        )
    ones = np.ones((int(good.sum()), 1))
    period = correlated(linear_fit(ones, rr[good], ("period",), ADVICE), ones)
    rate = period.derived(("rate",), np.array([60 / mean]), np.array([[-60 / mean**2]]))
    wave = np.empty(0)
    if is_pressure:
        phase = np.linspace(0, 1, PHASES, endpoint=False)
        pairs = zip(feet_s[:-1][good], rr[good], strict=True)
        beats = np.array([_beat(grid, level, foot, length, phase) for foot, length in pairs])
        shape = np.median(beats, axis=0)
        wave = diastolic + (systolic - diastolic) * (shape - shape.min()) / np.ptp(shape)
    return HeartCalibration(60 / mean, sd, systolic, diastolic, wave, rate)


def check_cuff(systolic_mmhg: float, diastolic_mmhg: float) -> tuple[float, float]:
    """A cuff reading that can be true. Raises `CalibrationError`."""
    if not 20 <= diastolic_mmhg < systolic_mmhg <= 300:
        raise CalibrationError(
            f"cuff {systolic_mmhg:g}/{diastolic_mmhg:g} mmHg: systolic must be above diastolic, "
            "both within 20 to 300 mmHg"
        )
    return systolic_mmhg, diastolic_mmhg


def _beat(grid: Array, level: Array, foot: float, length: float, phase: Array) -> Array:
    """One beat (PHASES,) with the line from its foot to the next one's taken off."""
    beat = np.interp(foot + length * phase, grid, level)
    start, end = np.interp([foot, foot + length], grid, level)
    return np.asarray(beat - start - (end - start) * phase)


def _feet(grid: Array, level: Array, step: float) -> Array:
    """Times (beats,) [s] at which each upstroke is steepest, moved back to its foot."""
    from scipy.signal import butter, find_peaks, sosfiltfilt

    band = butter(2, [RATES_HZ[0], 10.0], "bandpass", fs=1 / step, output="sos")
    calm = sosfiltfilt(band, level)
    power = float(calm @ calm)
    if power <= 1e-12 * float(level @ level) or power == 0:
        raise CalibrationError(f"the reference channel does not pulse; {ADVICE}")
    spectrum = np.fft.irfft(np.abs(np.fft.rfft(calm, 2 * len(calm))) ** 2)[: len(calm)]
    likeness = spectrum / (spectrum[0] * (1 - np.arange(len(calm)) / len(calm)))
    lags = np.arange(round(LOOK_BELOW / RATES_HZ[1] / step), min(round(2.0 / step), len(calm) // 2))
    peaks, _ = find_peaks(likeness[lags])
    if not len(peaks) or likeness[lags][peaks].max() < 0.3:
        raise CalibrationError(f"the reference channel shows no steady beat; {ADVICE}")
    strong = peaks[likeness[lags][peaks] > 0.8 * likeness[lags][peaks].max()]
    period = lags[strong[0]] * step  # the first of equals: not two beats taken for one
    rise = np.gradient(calm, step)
    steep, _ = find_peaks(rise, distance=max(round(NEARER_TO_ONE * period / step), 1))
    steep = steep[rise[steep] > STEEP * np.median(rise[steep])]
    back = round(0.25 * period / step)
    feet = []
    for n in steep.tolist():
        # the tangent at the steepest point meets the level of the trough before it
        trough = float(calm[max(n - back, 0) : n + 1].min())
        feet.append(float(grid[n] - (calm[n] - trough) / rise[n]))
    return np.array(feet)
