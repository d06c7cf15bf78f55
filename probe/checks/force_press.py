"""A press to a force: how fast its way down may be, and how small a force can end it."""

from probe.checks.touch_noise import least_touch_n, rounded_up
from probe.guards.levels import LEVEL_S

REACHED = 0.05
"""A force at rest within this of what was asked for is reached."""
FELT = 0.25
"""Share of the force at which the way down must show it."""
AT_ONCE = 0.5
"""Share of the force that the hardest thing beneath may add before the stage rests."""
STOP_S = 0.05
"""From a force at the tip to a tip at rest, beside the sensor's readings."""


def late_by_s(rate_hz: float, readings: int, filter_s: float) -> float:
    """How long [s] after a force the tip rests that this force stops."""
    return STOP_S + readings / rate_hz + filter_s


def force_speed_m_s(force_n: float, late_s: float, hardest_n_m: float) -> float:
    """The fastest way down on which the hardest thing beneath adds `AT_ONCE` of the force at most
    before the tip rests."""
    return AT_ONCE * force_n / (hardest_n_m * late_s)


def force_in_noise(name: str, noise_n: float, rate_hz: float, force_n: float) -> str | None:
    """Says so if a mean over `LEVEL_S` of a sensor with ``noise_n`` rms does not show the share
    `FELT` of ``force_n``; what does is known to 4 %, one standard error."""
    least_n = least_touch_n(noise_n, rate_hz, LEVEL_S * rate_hz) / FELT
    if force_n >= least_n:
        return None
    return (
        f"scan.force_n = {force_n:g} N is too little for {name}, {noise_n:.2g} N rms at "
        f"{rate_hz:g} Hz: where a press must end is lost in its noise; set scan.force_n to "
        f"{rounded_up(least_n):g} or more, or leave it out"
    )
