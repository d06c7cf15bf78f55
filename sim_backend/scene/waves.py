"""The lumen's pressure over one heartbeat, repeated.

Three sources: ``paper`` (half-cosines through four knots; the times are the paper's, its levels
are not given), ``brachial`` (eight harmonics, the mean of 8 measured subjects) and a CSV file.
Each is shifted and scaled to the scene's diastolic and systolic pressure and to its heart rate.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.core.files import FileRefused, read_file
from drivers.core.units import to_si
from sim_backend.arrays import Array
from sim_backend.scene.scene_file import MAX_FILE_BYTES, Pulse, SceneError

Shape = Callable[[Array], Array]

PA_PER_MMHG = to_si("mmHg")[1]
PAPER_PERIOD_S = 0.825
PAPER_TIMES_S = np.array([0.0, 0.10, 0.40, PAPER_PERIOD_S])
PAPER_LEVELS = np.array([90.0, 120.0, 80.0, 90.0])  # mmHg
# P(t) = mean + sum A_k cos(2 pi k t/T + phi_k), mmHg and rad: mean of 8 subjects measured at the
# brachial artery (data set repat8/cam-bpw-sim-pub), scaled to 120/80 mmHg.
BRACHIAL_MEAN = 96.61
BRACHIAL_AMPLITUDES = (13.94, 7.88, 4.43, 2.55, 2.20, 1.53, 0.98, 0.62)
BRACHIAL_PHASES = (-1.727, -2.203, -2.906, -3.057, 2.860, 2.368, 1.988, 1.752)


@dataclass(frozen=True)
class Wave:
    """A periodic pressure.

    ``shape`` maps the beat's phase (n,), 0 to 1, to a pressure in any unit; ``offset_pa`` and
    ``gain_pa`` bring it to diastolic and systolic pressure; ``period_s`` is one beat.
    """

    shape: Shape
    period_s: float
    offset_pa: float
    gain_pa: float

    def pressure_pa(self, time_s: Array) -> Array:
        """Pressure (n,) in Pa at ``time_s`` (n,) after the start of a beat."""
        phase = np.mod(np.asarray(time_s, dtype=float) / self.period_s, 1.0)
        return self.offset_pa + self.gain_pa * self.shape(phase)


def load_wave(pulse: Pulse, folder: Path | None = None) -> Wave:
    """The wave of a scene; a CSV path is taken relative to ``folder``. Raises `SceneError`."""
    if pulse.wave == "paper":
        shape: Shape = _paper
    elif pulse.wave == "brachial":
        shape = _brachial
    else:
        shape = _from_csv((folder or Path()) / pulse.wave)
    beat = shape(np.linspace(0.0, 1.0, 4096, endpoint=False))
    low, high = float(beat.min()), float(beat.max())
    diastolic_pa = pulse.diastolic_mmhg * PA_PER_MMHG
    gain_pa = (pulse.systolic_mmhg - pulse.diastolic_mmhg) * PA_PER_MMHG / (high - low)
    return Wave(shape, 60 / pulse.rate_bpm, diastolic_pa - gain_pa * low, gain_pa)


def _paper(phase: Array) -> Array:
    times, levels = PAPER_TIMES_S, PAPER_LEVELS
    t = phase * PAPER_PERIOD_S
    k = np.searchsorted(times[1:-1], t, side="right")
    part = (t - times[k]) / (times[k + 1] - times[k])
    smooth: Array = levels[k] + (levels[k + 1] - levels[k]) * (1 - np.cos(np.pi * part)) / 2
    return smooth


def _brachial(phase: Array) -> Array:
    total = np.full(np.shape(phase), BRACHIAL_MEAN)
    for k, (a, phi) in enumerate(zip(BRACHIAL_AMPLITUDES, BRACHIAL_PHASES, strict=True), start=1):
        total += a * np.cos(2 * np.pi * k * phase + phi)
    return total


def _from_csv(path: Path) -> Shape:
    """One beat: the file's last time is where the next beat begins."""
    times, levels = _read_csv(path)
    if len(times) < 4:
        raise SceneError(f"{path}: {len(times)} rows; a beat needs at least 4")
    if not (np.isfinite(times).all() and np.isfinite(levels).all()):
        raise SceneError(f"{path}: holds values that are not finite numbers")
    if (np.diff(times) <= 0).any():
        row = int(np.argmax(np.diff(times) <= 0)) + 3
        raise SceneError(f"{path}: line {row}: time_s must increase from row to row")
    if np.ptp(levels) <= 0:
        raise SceneError(f"{path}: pressure_mmhg never changes; a pulse must")
    span = times[-1] - times[0]
    return lambda phase: np.interp(phase * span + times[0], times, levels)


def _read_csv(path: Path) -> tuple[Array, Array]:
    try:
        text = read_file(path, MAX_FILE_BYTES).decode("utf-8-sig")
        lines = csv.DictReader(text.splitlines())
        rows = [(float(row["time_s"]), float(row["pressure_mmhg"])) for row in lines]
    except FileRefused as error:
        raise SceneError(
            f"pulse.wave = {str(path)!r}: not 'paper', 'brachial' or a CSV file ({error})"
        ) from None
    except KeyError as error:
        raise SceneError(f"{path}: column {error} is missing (time_s, pressure_mmhg)") from None
    except (TypeError, ValueError, csv.Error) as error:
        raise SceneError(f"{path}: not a table of numbers: {error}") from None
    columns = np.array(rows, dtype=float).reshape(-1, 2)
    return columns[:, 0], columns[:, 1]
