"""A sensor's own low pass, from a movement that the stage and the sensor both saw.

The sensor's signal is any function of the stage's, delayed by a line and behind a low pass of first
order: y' tau + y = f(s(t - delay)).
"""

import math
from dataclasses import dataclass, field

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

SLOWEST_S = 2.0
KNOTS = 8  # of the function, at equal shares of the stage's readings
DELAYS_S = np.linspace(0.0, 0.25, 26)  # as far as `calibration.latency` looks
TIMES = 16  # from the sensor's period to `SLOWEST_S`, where the search begins
MIN_PERIODS = 5
"""Of the slower of both: what is faster is not told from the way between two readings, and guards
allow for as many periods of a sensor anyway."""
ADVICE = "record several taps, or presses at several speeds, on something elastic"


@dataclass(frozen=True)
class LowPassFit:
    """``filter_s`` [s] and the ``delay_s`` [s] beside it, with their fit."""

    filter_s: float
    delay_s: float
    fit: Fit = field(repr=False)

    @property
    def interval_s(self) -> tuple[float, float]:
        """95 % interval of ``filter_s``."""
        low, high = self.fit.interval()[0]
        return float(low), float(high)


def fit_low_pass(stage_s: Array, stage: Array, sensor_s: Array, sensor: Array) -> LowPassFit | None:
    """The low pass between a stage's movement and a sensor's readings of it.

    Parameters
    ----------
    stage_s, stage
        (m,) [s] and any unit: where the stage was.
    sensor_s, sensor
        (n,) [s] and any unit: what was read.

    Returns
    -------
    None where the readings show no low pass slower than `MIN_PERIODS` of stage and sensor.

    Raises
    ------
    CalibrationError
        Where nothing moves, or times are not ascending.
    """
    ts, s = as_columns(stage_s, "stage_s", 1)[:, 0], as_columns(stage, "stage", 1)[:, 0]
    tf, f = as_columns(sensor_s, "sensor_s", 1)[:, 0], as_columns(sensor, "sensor", 1)[:, 0]
    same_length(stage_s=ts, stage=s)
    same_length(sensor_s=tf, sensor=f)
    if len(ts) < 20 or len(tf) < 20 or np.ptp(s) == 0 or np.ptp(f) == 0:
        raise CalibrationError(f"the stage or the sensor shows no movement; {ADVICE}")
    ascending("time_s", ts, "reading")
    ascending("sensor_time_s", tf, "reading")
    period_s = float(np.median(np.diff(tf)))
    t = np.arange(max(tf[0], ts[0] + DELAYS_S[-1]), min(tf[-1], ts[-1]), period_s)
    if len(t) < 10 * KNOTS:
        raise CalibrationError(f"stage and sensor have too little time in common; {ADVICE}")
    y = np.interp(t, tf, f)
    size = float(np.std(y))
    y = (y - y.mean()) / size
    knots = np.unique(np.quantile(s, np.linspace(0.0, 1.0, KNOTS)))

    def model(delay_s: float, filter_s: float) -> Array:
        """Each hat function of the stage's place (n, knots), behind the low pass."""
        place = np.interp(t - delay_s, ts, s)
        hats = np.column_stack([np.interp(place, knots, row) for row in np.eye(len(knots))])
        return _behind(hats, filter_s / period_s)

    def left(delay_s: float, filter_s: float) -> float:
        shares = model(delay_s, filter_s)
        return float(np.linalg.norm(shares @ np.linalg.lstsq(shares, y)[0] - y))

    times_s = [0.0, *np.geomspace(period_s, SLOWEST_S, TIMES)]
    start = min(((d, tau) for tau in times_s for d in DELAYS_S), key=lambda at: left(*at))
    if start[1] == 0.0:
        return None
    shares, *_ = np.linalg.lstsq(model(*start), y)
    names = ("log filter", "delay", *(f"shape {n}" for n in range(len(knots))))

    def misfit(p: Array) -> Array:
        return np.asarray(model(p[1], math.exp(min(p[0], math.log(10 * SLOWEST_S)))) @ p[2:] - y)

    def slopes(p: Array) -> Array:
        """Of the two times by differences of a thousandth of a period, else the model itself."""
        step, filter_s = 1e-3, math.exp(p[0])
        later = model(p[1] + step * period_s, filter_s) - model(p[1], filter_s)
        slower = model(p[1], filter_s * math.exp(step)) - model(p[1], filter_s)
        return np.column_stack(
            [slower @ p[2:] / step, later @ p[2:] / (step * period_s), model(p[1], filter_s)]
        )

    begin = np.concatenate([[math.log(start[1]), start[0]], shares])
    fit = nonlinear_fit(misfit, begin, names, ADVICE, jacobian=slopes)
    fit = correlated(fit, slopes(fit.values))
    filter_s, delay_s = math.exp(fit.values[0]), float(fit.values[1])
    turn = np.zeros((2, len(fit.values)))
    turn[0, 0], turn[1, 1] = filter_s, 1.0
    both = fit.derived(("filter", "delay"), np.array([filter_s, delay_s]), turn)
    found = LowPassFit(filter_s, delay_s, both)
    shortest_s = MIN_PERIODS * max(period_s, float(np.median(np.diff(ts))))
    return found if found.interval_s[0] > shortest_s else None


def _behind(signals: Array, periods: float) -> Array:
    """Signals (n, k) behind a low pass of that many periods, settled at their first values."""
    from scipy.signal import lfilter

    if periods <= 0.0:
        return signals
    lag = math.exp(-1.0 / periods)
    filtered, _ = lfilter([1.0 - lag], [1.0, -lag], signals, axis=0, zi=lag * signals[:1])
    return np.asarray(filtered)
