"""Every press of a recording: its level, its pulse at a rate that all share, and their doubts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from probe.detect.hold import Hold, NoHold, hold_of
from probe.detect.pulse import (
    Pulse,
    described,
    find_pulse,
    pulse_at,
    rates_hz,
)
from probe.detect.reference import find_pulse_by
from probe.recording import Recording, Station

Array = NDArray[np.float64]

REPEATABILITY_M = 10e-6
"""What a stage's depth differs by from station to station."""
STIFFENING = 1.15
"""Exponent of a cylinder's force against depth, between a flat face's 1 and a sphere's 1.5."""
VOTES = 3
"""Stations whose pulses settle the rate."""
USUAL_HZ, USUAL_SPREAD = 72 / 60, 0.3
"""Resting hearts: the median, and the standard deviation of the logarithm."""
UNKNOWN_DEPTH = 0.005
"""Station scatter over the level where no depth was recorded."""


@dataclass(frozen=True)
class Press:
    """A station with its pulse; None where there was nothing to judge by, and ``note`` says why.

    ``clipped`` is the share of the hold's samples that saturation took. ``level_sd_pa`` includes
    what a stage's repeatability makes of equal tissue.
    """

    station: Station
    pulse: Pulse | None
    level_sd_pa: float
    clipped: float
    note: str = ""

    @property
    def level_pa(self) -> float:
        return self.pulse.baseline_pa if self.pulse else float("nan")

    @property
    def size_pa(self) -> float:
        return self.pulse.size_pa if self.pulse else float("nan")


def presses_of(recording: Recording, false_alarm: float) -> tuple[Press, ...]:
    """All stations of a recording, in its order.

    Where the clearest pulse passes at ``false_alarm`` for the whole recording, every station's is
    measured at that heart's rate; p-values stay those of each station's own search.
    """
    found = [_own(station) for station in recording.stations]
    measured = [(hold, pulse) for hold, pulse, _ in found if hold is not None and pulse is not None]
    clear = [(h, p) for h, p in measured if p.p_value * len(measured) <= false_alarm]
    clear.sort(key=lambda m: m[1].p_value)
    shared = _shared_rate(clear[:VOTES]) if clear else None
    return tuple(
        _press(station, hold, _at(hold, pulse, shared), note)
        for station, (hold, pulse, note) in zip(recording.stations, found, strict=True)
    )


def _own(station: Station) -> tuple[Hold | None, Pulse | None, str]:
    try:
        hold = hold_of(station)
    except NoHold as error:
        return None, None, str(error)
    if len(station.reference):
        pulse = find_pulse_by(hold, station.reference_s - hold.start_s, station.reference)
        if pulse is not None:
            return hold, pulse, ""
        return hold, find_pulse(hold), "its reference has no beats: judged without it"
    return hold, find_pulse(hold), ""


def _at(hold: Hold | None, own: Pulse | None, rate_hz: float | None) -> Pulse | None:
    if hold is None or own is None or rate_hz is None or own.by_reference:
        return own
    return pulse_at(hold, rate_hz, own.p_value, own.scale)


def _shared_rate(clear: list[tuple[Hold, Pulse]]) -> float:
    """The rate that explains the clearest pulses best, given what rates hearts have."""
    rates = max((rates_hz(hold.span_s) for hold, _ in clear), key=len)

    def unlikely(rate_hz: float) -> float:
        usual = 0.5 * (np.log(rate_hz / USUAL_HZ) / USUAL_SPREAD) ** 2
        return float(usual + sum(_misfit(hold, pulse, rate_hz) for hold, pulse in clear))

    best = int(np.argmin([unlikely(rate) for rate in rates.tolist()]))
    low, high = rates[max(best - 1, 0)], rates[min(best + 1, len(rates) - 1)]
    found = minimize_scalar(unlikely, bounds=(low, high), method="bounded", options={"maxiter": 25})
    return float(found.x)


def _misfit(hold: Hold, pulse: Pulse, rate_hz: float) -> float:
    """Minus the log likelihood, the noise's level unknown."""
    one, _ = described(hold, rate_hz, pulse.fit.colour, pulse.scale)
    return 0.5 * len(hold.time_s) * float(np.log(max(one.rss, 1e-300)))


def _press(station: Station, hold: Hold | None, pulse: Pulse | None, note: str) -> Press:
    if hold is None or pulse is None:
        return Press(station, None, float("nan"), 1.0 if "clipped" in note else 0.0, note)
    depth_m = _depth_m(station)
    share = STIFFENING * REPEATABILITY_M / depth_m if depth_m > 0 else UNKNOWN_DEPTH
    scatter = float(np.hypot(pulse.baseline_sd_pa, share * abs(pulse.baseline_pa)))
    if hold.clipped > 0:
        lost = f"{100 * hold.clipped:.0f} % of its samples are clipped: press less deep"
        note = f"{note}; {lost}" if note else lost
    return Press(station, pulse, scatter, hold.clipped, note)


def _depth_m(station: Station) -> float:
    held = station.time_s >= station.hold_s if np.isfinite(station.hold_s) else station.time_s > 0
    depth = station.depth_m[held] if len(station.depth_m) == len(held) else station.depth_m
    depth = depth[np.isfinite(depth)]
    return float(np.median(depth)) if len(depth) else 0.0
