"""Force sensors and taxel arrays: from raw readings to newtons and pascals.

The known loads are exact and the readings noisy, so the readings are regressed on the loads
(classical calibration) and the result is inverted:

    raw = offset + sensitivity @ load + temperature (T - T0) + noise
    load = pinv(sensitivity) @ (raw - offset - temperature (T - T0))
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, Mask, as_columns, linear_fit, outlier, same_length, stacked
from calibration.rounding import no_finer

ADVICE = "add readings at other loads (each axis alone, both directions, at least three levels)"


ENOUGH = 5
"""Loads beyond the unknowns whose scatter shows rounding: by two alone 68 to 92 % held."""


@dataclass(frozen=True)
class ForceCalibration:
    """``sensitivity`` (channels, axes) [raw/load], ``offset`` and ``temperature`` (channels,).

    ``linearity`` and ``hysteresis`` are fractions of the full span. ``fit`` holds, channel after
    channel, offset, sensitivities and (if measured) the temperature term.
    """

    KIND: ClassVar[str] = "force"
    UNITS: ClassVar[dict[str, str]] = {
        "sensitivity": "raw/N",
        "offset": "raw",
        "temperature": "raw/K",
        "reference_c": "degC",
        "linearity": "1",
        "hysteresis": "1",
    }
    sensitivity: Array
    offset: Array
    temperature: Array
    reference_c: float
    linearity: float
    hysteresis: float
    fit: Fit = field(repr=False)

    @property
    def crosstalk(self) -> Array:
        """(channels, axes): response of a channel to an axis over its response to its own."""
        return np.asarray(self.sensitivity / np.diag(self.sensitivity)[:, None])

    def load(self, raw: Array, temperature_c: Array | float | None = None) -> Array:
        """Loads (n, axes) from readings (n, channels)."""
        excess = np.asarray(raw, dtype=float) - self.offset
        if temperature_c is not None:
            warmer = np.asarray(temperature_c, dtype=float) - self.reference_c
            excess = excess - np.multiply.outer(warmer, self.temperature)
        return np.asarray(excess @ np.linalg.pinv(self.sensitivity).T)

    def misses(self, raw: Array, load_n: Array, temperature_c: Array | None = None) -> Array:
        """Readings (n * channels,) less what this expects; offsets are a tare's to take."""
        expected = np.asarray(load_n) @ self.sensitivity.T
        if temperature_c is not None:
            expected = expected + np.multiply.outer(temperature_c, self.temperature)
        off = np.asarray(raw) - expected
        return np.asarray((off - off.mean(axis=0)).ravel())


def fit_force(
    raw: Array,
    load_n: Array,
    temperature_c: Array | None = None,
    saturated: Mask | None = None,
) -> ForceCalibration:
    """Gain, offset, crosstalk and temperature term from readings under known loads.

    ``raw`` (n, channels), ``load_n`` (n, axes) [N or N m], ``temperature_c`` (n,),
    ``saturated`` (n, channels): rows with a clipped channel are left out. There must be at
    least as many channels as axes. Raises `CalibrationError` on degenerate data.
    """
    raw, loads = as_columns(raw, "raw"), as_columns(load_n, "load_n")
    same_length(raw=raw, load_n=loads)
    if raw.shape[1] < loads.shape[1]:
        raise CalibrationError(
            f"{raw.shape[1]} channels cannot tell {loads.shape[1]} axes apart; leave axes out"
        )
    kept = np.ones(len(raw), dtype=bool) if saturated is None else ~saturated.any(axis=1)
    raw, loads = raw[kept], loads[kept]
    axes = loads.shape[1]
    design, names, mean_c = [np.ones(len(raw)), *loads.T], ["offset"], 0.0
    names += [f"sensitivity[{axis}]" for axis in range(axes)]
    advice = ADVICE
    if temperature_c is not None:
        degrees = as_columns(temperature_c, "temperature_c", 1)[kept, 0]
        mean_c = float(degrees.mean())
        design.append(degrees - mean_c)
        names.append("temperature")
        advice += "; let the temperature vary independently of the load, or leave it out"
    matrix = np.column_stack(design)
    fits = [linear_fit(matrix, channel, names, advice) for channel in raw.T]
    values = np.array([fit.values for fit in fits])
    sensitivity = values[:, 1 : axes + 1]
    _check_answer(fits, axes, np.flatnonzero(kept))
    if np.linalg.matrix_rank(sensitivity, tol=1e-6 * np.abs(sensitivity).max()) < axes:
        raise CalibrationError(
            "the channels answer all axes in the same proportion: check the wiring and that each "
            "axis was loaded alone"
        )
    back = (raw - values[:, 0] - (matrix[:, axes + 1 :] @ values[:, axes + 1 :].T)) @ (
        np.linalg.pinv(sensitivity).T
    )
    span = np.ptp(loads, axis=0)
    return ForceCalibration(
        sensitivity=sensitivity,
        offset=values[:, 0],
        temperature=values[:, axes + 1] if temperature_c is not None else np.zeros(len(fits)),
        reference_c=mean_c,
        linearity=float(np.max(np.abs(_level_means(loads, back - loads)[0]) / span)),
        hysteresis=max(hysteresis(loads[:, a], back[:, a]) for a in range(axes)),
        fit=stacked(
            [_as_read(fit, matrix, channel) for fit, channel in zip(fits, raw.T, strict=True)]
        ),
    )


def _as_read(fit: Fit, design: Array, readings: Array) -> Fit:
    """With what readings of a load share: by its scatter between loads, or where these are few, or
    show none, by that of the step in which ``readings`` (n,) are written."""
    found = _by_levels(fit, design)
    left = len(np.unique(design, axis=0)) - design.shape[1]
    return found if found is not fit and left >= ENOUGH else no_finer(found, design, readings)


def _by_levels(fit: Fit, design: Array) -> Fit:
    """With what repeats of a load share, rounding or a bend of the response, counted once for each
    of the rows that ``design`` (n, p) repeats, where it is more than their noise explains (Draper
    and Smith, Applied Regression Analysis, 1998, section 2.1: lack of fit)."""
    from scipy.special import fdtri, stdtrit

    means, count = _level_means(design, fit.residuals[:, None])
    dof, repeats = len(count) - len(fit.values), len(design) - len(count)
    if dof < 1 or repeats < 1:
        return fit
    squares, lack = float(fit.residuals @ fit.residuals), float(count @ means[:, 0] ** 2)
    noise = max(squares - lack, 0.0) / repeats
    if lack / dof <= noise * fdtri(dof, repeats, 0.95):
        return fit
    # of fewer degrees of freedom, but the other channels' intervals go by the fit's
    fewer = stdtrit(dof, 0.975) / stdtrit(fit.dof, 0.975)
    wider = float(fewer) ** 2 * (lack / dof) / (squares / fit.dof)
    return replace(fit, covariance=wider * fit.covariance)


def _check_answer(fits: Sequence[Fit], axes: int, rows: NDArray[np.intp]) -> None:
    """Each axis must change a channel by more than noise does; dividing by such a gain would make
    newtons of noise. A dead channel passes once in a hundred times."""
    for axis in range(axes):
        ends = np.array([fit.interval(0.99)[1 + axis] for fit in fits])
        if (ends[:, 0] * ends[:, 1] <= 0).all():
            far = [outlier(fit.residuals, fit.leverage, fit.values.size) for fit in fits]
            first = next((rows[row] + 1 for row in far if row is not None), None)
            raise CalibrationError(
                f"no reading changes with load {axis} by more than its noise: "
                + (f"reading {first} is far from all others; look at it first" if first
                   else "check that the loads were on this sensor, its wiring and its columns, or "
                   "take larger loads")
            )  # fmt: skip


def hysteresis(load: Array, reading: Array) -> float:
    """Largest mean gap between rising and falling loads, over the span of ``reading``.

    Both (n,), in the order taken. 0 where no load was approached from both sides.
    """
    load, reading = np.asarray(load, dtype=float), np.asarray(reading, dtype=float)
    step = np.diff(load, prepend=load[0])
    moved = np.where(step != 0, np.arange(len(step)), -1)
    last = np.maximum.accumulate(moved)  # a repeated load belongs to the step that led to it
    heading = np.where(last >= 0, np.sign(step[np.maximum(last, 0)]), 0)
    gaps = [
        abs(reading[(load == level) & (heading > 0)].mean() - reading[down].mean())
        for level in np.unique(load)
        if (down := (load == level) & (heading < 0)).any()
        and ((load == level) & (heading > 0)).any()
    ]
    return float(max(gaps, default=0.0) / max(np.ptp(reading), 1e-300))


def _level_means(levels: Array, error: Array) -> tuple[Array, NDArray[np.intp]]:
    """Mean error (m, axes) of equal rows of ``levels`` (n, p), and how many of them there are (m,):
    noise averages out, nonlinearity stays."""
    _, group = np.unique(levels, axis=0, return_inverse=True)
    count = np.bincount(group.ravel())
    sums = [np.bincount(group.ravel(), weights=column) for column in error.T]
    return np.asarray(np.array(sums).T / count[:, None]), count
