"""What the force of a touch, or one to press to, must be to stand out of a sensor's noise."""

import math

from probe.guards.levels import LEVEL_S, MIN_STANDARD_ERRORS

SHOWN = 0.25  # share of a force to press to that must show on the way down


def least_touch_n(noise_n: float, rate_hz: float, readings: float) -> float:
    """The least force that the mean of ``readings`` distinguishes from a sensor's noise,
    ``noise_n`` rms, beside a zero that is itself a mean over `LEVEL_S`."""
    zeroed = max(LEVEL_S * rate_hz, 1.0)
    return MIN_STANDARD_ERRORS * noise_n * math.sqrt(1 / max(readings, 1.0) + 1 / zeroed)


def touch_readings(noise_n: float, rate_hz: float, touch_n: float) -> int:
    """Over how many readings a touch is averaged: the fewest that do, of `LEVEL_S` at most."""
    most = max(round(LEVEL_S * rate_hz), 1)
    enough = (n for n in range(1, most) if least_touch_n(noise_n, rate_hz, n) <= touch_n)
    return next(enough, most)


def rounded_up(least_n: float) -> float:
    """To two digits, so that it passes."""
    digit_n: float = 10 ** (math.floor(math.log10(least_n)) - 1)
    return math.ceil(least_n / digit_n) * digit_n


def touch_in_noise(
    name: str, noise_n: float, rate_hz: float, touch_n: float, readings: float = math.inf
) -> str | None:
    """Says so if a sensor at rest, ``noise_n`` rms, may reach ``touch_n`` in the mean of `LEVEL_S`:
    the surface would be found in the air, and the press be that much shallower.

    An rms of few ``readings`` is off by itself, by one part in sqrt(2 (readings - 1)); a touch that
    passes with an rms smaller by two such errors is believed.
    """
    least_n = least_touch_n(noise_n, rate_hz, LEVEL_S * rate_hz)
    if not touch_n < least_n / (1 + 2 / math.sqrt(2 * max(readings - 1, 1))):
        return None
    return (
        f"touch_n = {touch_n:g} N is within the noise of {name}, {noise_n:.2g} N rms: a touch "
        f"would be found in the air; set scan.touch_n to {rounded_up(least_n):g} or more, "
        "or leave it out"
    )


def force_in_noise(name: str, noise_n: float, rate_hz: float, force_n: float) -> str | None:
    """Says so if a mean over `LEVEL_S` of a sensor with ``noise_n`` rms does not show the share
    `SHOWN` of ``force_n``; one that does is known to 4 %, a standard error."""
    least_n = least_touch_n(noise_n, rate_hz, LEVEL_S * rate_hz) / SHOWN
    if not force_n < least_n:
        return None
    return (
        f"{force_n:.2g} N are too little to press to by {name}, {noise_n:.2g} N rms at "
        f"{rate_hz:g} Hz: where it ends would be noise; set scan.force_n, or what lies between "
        f"two of scan.steps_n, to {rounded_up(least_n):g} or more, or leave it out"
    )
