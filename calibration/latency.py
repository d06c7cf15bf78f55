"""Delay and clock skew of a sensor against the stage, from a tap or a chirp both can see.

A sample stamped t was taken at t - delay - skew (t - middle). The sensor's signal is modelled as
any function of the stage's (straight pieces between knots), so neither a curved relation nor the
air before a tap does harm; creep and relaxation would look like a delay, so tap on something
elastic (steel spring, rigid block), not on tissue.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import (
    Array,
    Fit,
    as_columns,
    ascending,
    correlated,
    nonlinear_fit,
    same_length,
)
from calibration.rounding import rounding_error, step_of

ADVICE = "record a chirp of 1 to 20 Hz, or several taps, over ten seconds or more"
MAX_DELAY_S = 0.25
SHORTEST_S = 4.0
SPLINE_DEGREE = 2
KNOTS = 16  # of the sensor's signal as a function of the stage's
DRAWS = 32  # of what rounding and sampling may have done: the interval is known to an eighth
PLAIN = 5  # pieces between knots in one
SMOOTH = 3.0  # times nearer a smooth course is to readings left out of it than a straight one
RANGE_WEIGHT = 0.2  # weight of the stage's range against the change of the signal in placing them


@dataclass(frozen=True)
class LatencyCalibration:
    """``delay_s`` at ``middle_s`` (stamp less truth) and ``skew`` (fraction the stamps gain)."""

    KIND: ClassVar[str] = "latency"
    UNITS: ClassVar[dict[str, str]] = {"delay_s": "s", "skew": "1", "middle_s": "s"}
    delay_s: float
    skew: float
    middle_s: float
    fit: Fit = field(repr=False)

    def true_time(self, stamp_s: Array) -> Array:
        """When samples were taken [s], on the stage's clock.

        Without the skew, which holds within one session of the sensor's clock only.
        """
        return np.asarray(np.asarray(stamp_s, dtype=float) - self.delay_s)


def fit_latency(stage_s: Array, stage: Array, sensor_s: Array, sensor: Array) -> LatencyCalibration:
    """Delay and skew from one movement seen by both.

    ``stage`` (m,) at ``stage_s`` (m,), ``sensor`` (n,) at ``sensor_s`` (n,); any units. Delays up
    to 0.25 s are searched. Raises `CalibrationError` when nothing moves, when the movement
    repeats itself (the delay is then ambiguous) or when the two have nothing in common.

    The interval counts what rounding of either signal and the stage's way between its samples may
    hide (`_missed`). Of 30 draws each it holds the delay, in brackets by residuals alone: of
    presses at 5 N/s, read in steps of 0.05 N with 1 mN of noise, in 30 (2; half width 0.76 ms for
    0.09, the delay being 0.36 off), in steps of 0.02 N in 30 (2), of a stage that is read at 20 Hz
    in 30 (8; 0.81 ms for 0.17); of taps of a stage with steps of 20 um in 29 (8; 0.08 ms for 0.02),
    of 100 um in 30 (17; 0.37 for 0.10); without rounding in 30 (29; 0.032 ms for 0.026).
    """
    from scipy.interpolate import CubicSpline

    ts, s = as_columns(stage_s, "stage_s", 1)[:, 0], as_columns(stage, "stage", 1)[:, 0]
    tf, f = as_columns(sensor_s, "sensor_s", 1)[:, 0], as_columns(sensor, "sensor", 1)[:, 0]
    same_length(stage_s=ts, stage=s)
    same_length(sensor_s=tf, sensor=f)
    if len(ts) < 20 or len(tf) < 20 or np.ptp(s) == 0 or np.ptp(f) == 0:
        raise CalibrationError(f"the stage or the sensor shows no movement; {ADVICE}")
    ascending("time_s", ts, "reading")  # a table's rows may be those of both, by turns
    ascending("sensor_time_s", tf, "reading")
    start = _coarse(ts, s, tf, f)
    inside = (tf > ts[0] + MAX_DELAY_S) & (tf < ts[-1] - MAX_DELAY_S)
    if inside.sum() < 20 or np.ptp(tf[inside]) < SHORTEST_S:
        raise CalibrationError(
            f"stage and sensor have less than {SHORTEST_S:g} s of movement in common, too short to "
            f"tell a delay from a clock's drift; {ADVICE}"
        )
    t, y = tf[inside], f[inside] - f[inside].mean()
    middle, span = float(t.mean()), float(np.ptp(t))
    course = CubicSpline(ts, _smoothed(ts, s) / np.std(s))
    rate = course.derivative()
    size = float(np.std(y))
    start = _nearer(start, max(float(np.median(np.diff(at))) for at in (ts, t)), course, t, y)
    knots = _knots(course(t - start), y)

    def delayed(p: Array) -> tuple[Array, Array, Array]:
        lag = t - start - p[0] - p[1] * (t - middle) / span
        return (*_pieces(course(lag), knots), rate(lag))

    def misfit(p: Array) -> Array:
        shares, _, _ = delayed(p)
        return np.asarray(shares @ p[2:] - y / size)

    def slopes(p: Array) -> Array:
        shares, steps, speed = delayed(p)
        turned = -(steps @ p[2:]) * speed
        return np.column_stack([turned, turned * (t - middle) / span, shares])

    first, *_ = np.linalg.lstsq(delayed(np.zeros(2))[0], y / size)
    names = ("delay", "skew", *(f"shape {n}" for n in range(len(knots))))
    fit = nonlinear_fit(
        misfit, np.concatenate([np.zeros(2), first]), names, ADVICE, jacobian=slopes
    )
    if fit.rms > 0.9:
        raise CalibrationError(
            f"the sensor follows the stage in only {100 * (1 - fit.rms**2):.0f} % of its variance; "
            "check that the probe stays in contact and that both columns are the right ones"
        )
    turn = np.zeros((2, len(fit.values)))
    turn[0, 0], turn[1, 1] = 1, 1 / span
    lag = t - start - fit.values[0] - fit.values[1] * (t - middle) / span
    steps = step_of(s) / float(np.std(s)), step_of(f) / size
    few = _plain(knots)
    plain, *_ = np.linalg.lstsq(_pieces(course(lag), few)[0], y / size)
    missed = _missed(ts, course, lag, lambda at: _pieces(at, few)[0] @ plain, steps, fit.noise)
    follow = np.linalg.pinv(slopes(fit.values)) @ missed
    fit = correlated(fit, slopes(fit.values))
    fit = replace(fit, covariance=fit.covariance + follow @ follow.T / DRAWS)
    both = fit.derived(("delay", "skew"), turn @ fit.values + [start, 0.0], turn)
    return LatencyCalibration(float(both.values[0]), float(both.values[1]), middle, both)


def _nearer(
    start: float, sample_s: float, course: Callable[[Array], Array], t: Array, y: Array
) -> float:
    """The delay [s] within a sample of ``start`` at which a plain function leaves least.

    From half a sample off the full one may turn at every reading, and fit there just as well.
    """
    from scipy.optimize import minimize_scalar

    few = _plain(_knots(course(t - start), y))

    def left(delay_s: float) -> float:
        shares, _ = _pieces(course(t - delay_s), few)
        return float(np.linalg.norm(y - shares @ np.linalg.lstsq(shares, y)[0]))

    bounds = (start - sample_s, start + sample_s)
    return float(minimize_scalar(left, bounds=bounds, method="bounded").x)


def _plain(knots: Array) -> Array:
    """Few of the knots: of a function that does not follow the steps of readings."""
    return np.unique(np.append(knots[::PLAIN], knots[-1]))


def _smoothed(ts: Array, s: Array) -> Array:
    """The stage's places (m,) less their mean; of rounded ones, as smooth as rounding allows.

    A staircase moves at its edges only: the delay would be that of a few of them.
    """
    from scipy.interpolate import UnivariateSpline

    step = step_of(s)
    moving = int(np.count_nonzero(np.diff(s)))
    if not step:
        return np.asarray(s - s.mean())
    return np.asarray(UnivariateSpline(ts, s - s.mean(), s=moving * step**2 / 12)(ts))


def _between(ts: Array, places: Array) -> Callable[[Array], Array]:
    """The movement between samples: straight, since it may turn there, or smooth where that
    predicts every other sample far better from its neighbours."""
    from scipy.interpolate import CubicSpline

    half, left = ts[::2], slice(1, len(ts) - 1, 2)
    smooth = CubicSpline(half, places[::2])(ts[left]) - places[left]
    straight = np.interp(ts[left], half, places[::2]) - places[left]
    if SMOOTH * np.linalg.norm(smooth) < np.linalg.norm(straight):
        return CubicSpline(ts, places)
    return lambda at: np.interp(at, ts, places)


def _missed(
    ts: Array,
    course: Callable[[Array], Array],
    lag: Array,
    shape: Callable[[Array], Array],
    steps: tuple[float, float],
    noise: float,
) -> Array:
    """Errors (n, DRAWS) of the sensor's model at ``lag`` (n,) [s] on the stage's clock, had the
    same movement been sampled a part of a sample later, and stage and sensor counted their
    ``steps`` from elsewhere. ``noise`` is the sensor's, its rounding included, which is at most an
    eighth of a step squared: two readings a step, one of them on an edge.

    Residuals do not show these errors where they repeat from tap to tap, or are those of a delay:
    of a ramp by one step in two samples all edges are late alike.
    """
    from scipy.interpolate import CubicSpline

    stage_step, sensor_step = steps
    dither = np.sqrt(max(noise**2 - sensor_step**2 / 8, 0.0))
    sample_s = max(float(np.median(np.diff(ts))), float(np.median(np.diff(lag))))
    places = course(ts)
    between = _between(ts, places)
    found = []
    for later, *counted in np.random.default_rng(0).uniform(-0.5, 0.5, (DRAWS, 3)):
        later_s = later * sample_s
        true = between(ts + later_s)
        read = true + rounding_error(true + counted[0] * stage_step, stage_step, 0.0)
        seen = CubicSpline(ts + later_s, read)
        level = shape(between(lag + later_s))
        own = rounding_error(level + counted[1] * sensor_step, sensor_step, dither)
        found.append(shape(seen(lag + later_s)) - level - own)
    return np.array(found).T


def _knots(course: Array, y: Array) -> Array:
    """Knots of the static function: closer together where the sensor's signal changes more.

    Each piece has an equal share of the samples that are sorted by the stage's signal and of the
    sensor's change over them, so that the air above a touch takes one piece, not all.
    """
    order = np.argsort(course)
    levels, force = course[order], y[order]
    groups = np.array_split(np.arange(len(order)), 4 * KNOTS)
    at = np.array([levels[g].mean() for g in groups])
    change = np.abs(np.gradient(np.array([force[g].mean() for g in groups])))
    share = np.cumsum(
        change / max(change.sum(), 1e-300) + RANGE_WEIGHT * np.gradient(at) / np.ptp(at)
    )
    inner = np.interp(np.linspace(share[0], share[-1], KNOTS)[1:-1], share, at)
    return np.unique(np.concatenate([[levels[0]], inner, [levels[-1]]]))


def _pieces(values: Array, knots: Array) -> tuple[Array, Array]:
    """Quadratic B-splines (n, knots + 1) at ``values`` (n,), and their derivatives."""
    from scipy.interpolate import BSpline

    full = np.concatenate([[knots[0]] * SPLINE_DEGREE, knots, [knots[-1]] * SPLINE_DEGREE])
    at = np.clip(values, knots[0], knots[-1])
    basis = BSpline(full, np.eye(len(full) - SPLINE_DEGREE - 1), SPLINE_DEGREE)
    return np.asarray(basis(at)), np.asarray(basis.derivative()(at))


def _coarse(ts: Array, s: Array, tf: Array, f: Array) -> float:
    """The delay to within a sample, by cross-correlation of the rates of change."""
    from scipy.signal import correlate

    step = max(float(np.median(np.diff(ts))), float(np.median(np.diff(tf))))
    begin, end = max(ts[0], tf[0]), min(ts[-1], tf[-1])
    if end - begin < 4 * MAX_DELAY_S:
        raise CalibrationError(
            f"stage and sensor overlap for {max(end - begin, 0):.2f} s; {ADVICE}"
        )
    grid = np.arange(begin, end, step)
    a, b = np.interp(grid, ts, s), np.interp(grid, tf, f)
    a, b = (a - a.mean()) / np.std(a), (b - b.mean()) / np.std(b)
    both = np.abs(correlate(b, a, mode="full")) / len(grid)
    lags = (np.arange(len(both)) - len(grid) + 1) * step
    near = np.abs(lags) <= MAX_DELAY_S
    value, lags = both[near], lags[near]
    best = int(np.argmax(value))
    if value[best] < 0.2:
        raise CalibrationError(
            f"stage and sensor correlate by only {value[best]:.2f}; check the columns; {ADVICE}"
        )
    peaks = np.flatnonzero((value[1:-1] > value[:-2]) & (value[1:-1] >= value[2:])) + 1
    rivals = [n for n in peaks if abs(lags[n] - lags[best]) > 3 * step]
    if best in (0, len(value) - 1) or any(value[n] > 0.95 * value[best] for n in rivals):
        raise CalibrationError(
            f"the movement repeats itself or the delay exceeds {MAX_DELAY_S:g} s: several delays "
            f"explain the data equally well; {ADVICE}"
        )
    return float(lags[best])
