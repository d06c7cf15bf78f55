"""The step in which a sensor's readings come, and what rounding to it does to them.

Below a noise of some half a step rounding's error is no noise: of 0.2 steps of it the mean of any
number of readings is off by up to (step / pi) exp(-2 pi^2 0.2^2) = 0.14 steps (Widrow and Kollar
2008, Quantization Noise, chapter 4).
"""

from dataclasses import replace

import numpy as np

from calibration.fit import Array, Fit

DITHERED = 0.6
"""Standard deviation of readings over their step, from which on a mean is as good: their noise is
0.53 steps by then, where means are off by 0.1 % of a step."""
SAME = 1e-9
"""Of the largest reading: numbers nearer than this differ by the computer's rounding alone."""
SINES = 8
"""Of the sawtooth that rounding adds: further ones are a tenth of the first, or less."""
EVEN = 0.01
"""Of a step: what distinct readings may be off its multiples."""
EVENLY = 1 / 12
"""Variance of a level that may be anywhere within a step, in squared steps."""
DIGITS = 9
"""Decimal places that a table may be rounded to; numbers of a computer have 16 digits."""
LEAST_SCATTER = 1e-3
"""Of a variance: with less the degrees of freedom are a million times as many, which is enough."""
OF_A_DIGIT = (1, 2, 3, 4, 5, 25)
"""Steps of instruments, in units of the last place that they show."""


def least_step(readings: Array) -> float:
    """The least difference between two of ``readings`` (n,), 0 where all are the same."""
    levels = np.unique(readings)
    gaps = np.diff(levels)
    return float(min(gaps[gaps > SAME * float(np.abs(levels).max())], default=0.0))


def step_of(readings: Array) -> float:
    """The step of ``readings`` (n,): their `least_step`, where all differences are multiples of it;
    0 where they are not."""
    step = least_step(readings)
    codes = (readings - readings.min()) / (step or 1.0)
    return step if np.abs(codes - np.round(codes)).max() < EVEN else 0.0


def written_step(readings: Array) -> float:
    """The step in which ``readings`` (n,) are written: the last decimal place that any of them
    uses, times the largest of `OF_A_DIGIT` by which all of them differ; 0 beyond `DIGITS`.

    Of few readings at loads far from each other `step_of` finds no step, or a multiple of it.
    """
    for digits in range(DIGITS + 1):
        places = readings * 10.0**digits
        if np.abs(places - np.round(places)).max() < EVEN:
            common = int(np.gcd.reduce(np.diff(np.round(places)).astype(np.int64)))
            return float(10.0**-digits * max(k for k in OF_A_DIGIT if common % k == 0))
    return 0.0


def no_finer(fit: Fit, design: Array, readings: Array) -> Fit:
    """``fit`` of ``design`` (n, p), whose rows are loads that repeat, to ``readings`` (n,) that are
    known to their `written_step`: repeats that do not scatter over more are all rounded alike, and
    what is left of them says nothing of it. Rounding's own variance is added.

    How often 95 % intervals of a channel's sensitivity hold, of 200 draws each of gain and offset
    (in brackets by scatter alone), its readings in steps of 0.02 to 0.3 N: of loads of 0 to 3 N
    once, with 0.01 N of noise, 97 to 100 (67 to 92) %; five times each 98 to 100 (68 to 92) %;
    of 0, 1, 2, 3, 2, 1, 0 N with 2 mN 98 to 100 (67 to 74) %.
    """
    step = written_step(readings)
    if fit.noise > DITHERED * step:
        return fit
    loads = np.unique(design, axis=0)
    own = EVENLY * step**2 * np.linalg.pinv(loads.T @ loads)
    covariance = fit.covariance + own
    scatter = float((np.diag(fit.covariance) / np.maximum(np.diag(covariance), 1e-300)).max())
    dof = fit.dof / max(scatter, LEAST_SCATTER) ** 2  # (Satterthwaite 1946): rounding's is known
    return replace(fit, covariance=covariance, dof=int(dof))


def no_nearer(fit: Fit, design: Array, readings: Array) -> Fit | None:
    """``fit`` of ``design`` (n, p) to ``readings`` (n,) in time that come in steps coarser than
    their noise; None where they do not.

    The level is then known to a step, and no better by more readings, but for what averages out
    over the steps that the fitted line crosses. Of these, one at an end and as much of one as lies
    between two readings, whose beat with the steps may be slow, are left. What follows on itself in
    the residuals is the rounding.

    95 % intervals of a tare's bias and drift then hold in 98 to 100 % of 60 draws each (600
    readings at 10 Hz, noise of 0.01 to 0.4 steps, drift of 0.002 to 3 steps a second); by least
    squares alone the bias held in 0 to 100 %.
    """
    step = step_of(readings)
    if not step or fit.noise > DITHERED * step:
        return None
    way = max(float(np.ptp(design @ fit.values)) / step, 1e-9)
    left = min(1 / way + way / len(readings), 1.0)
    alone = len(readings) * np.linalg.inv(
        design.T @ design
    )  # the covariance by one reading's worth
    return replace(fit, covariance=fit.covariance + EVENLY * (left * step) ** 2 * alone)


def rounding_error(level: Array, step: float, noise: float) -> Array:
    """What rounding to multiples of ``step`` adds on average to ``level`` (n,), all in one unit,
    under normal noise of this standard deviation (Widrow and Kollar, as above)."""
    if not step:
        return np.zeros(len(level))
    if not noise:
        return np.asarray(step * np.round(level / step) - level)
    order = np.arange(1, SINES + 1)
    left = np.exp(-2 * (np.pi * order * noise / step) ** 2)
    size = (-1.0) ** order * step / (np.pi * order) * left
    return np.asarray(np.sin(2 * np.pi * np.outer(level / step, order)) @ size)
