"""Levels of force: what a sensor says at rest, and whether two of them are the same."""

import math
from collections import defaultdict
from collections.abc import Mapping
from statistics import median

from probe.guards.press_guard import FLAT, LITTLE_SHARE, NOISE_SIGMAS

LEVEL_S = 0.1  # a level is the mean force over this long
MAX_LEVEL_S = 1.0  # and over up to this where there are fewer than two readings in it
MAX_HIDDEN_SHARE = 0.1  # share of the force limit that a tare may hide at most
MIN_STANDARD_ERRORS = 6.0  # of a difference between two levels: by chance once in 500 million
UNSTEADY = 4.0  # of two readings, the fewest, 0.7 % are as far apart by chance: one more level
MAX_UNSTEADY_S = 2.0  # a cough is over by then
STILL = 2.0  # times its usual error, which 20 readings of noise give to a sixth

Levels = Mapping[str, tuple[float, float]]  # sensor -> mean force [N] and its standard error


def unknown(levels: Levels) -> str | None:
    """A sensor that had too few readings for a mean and its error; None if all had enough."""
    return next((name for name, (_, error) in levels.items() if not math.isfinite(error)), None)


class Usual:
    """How sure levels usually are: the median of their standard errors, by sensor.

    A patient who coughs against the probe makes a level unsure. As a zero it would be off by a
    part of the cough; and judged by its own error, no difference to it would be one.
    """

    def __init__(self) -> None:
        self._errors: dict[str, list[float]] = defaultdict(list)

    def add(self, levels: Levels) -> None:
        for name, (_, error) in levels.items():
            self._errors[name].append(error)

    def error_n(self, name: str) -> float:
        """Standard error of a level; NaN before the first."""
        return median(self._errors[name]) if self._errors[name] else math.nan

    def unsteady(self, levels: Levels) -> str | None:
        """Which sensor's force was less at rest than it usually is; None if none was.

        Not judged where most levels are exact, as a coarse sensor's are.
        """
        for name, (_, error) in levels.items():
            usual = self.error_n(name)
            if error > UNSTEADY * usual > 0:
                return f"{name}: the force was uncertain by {error:.2g} N (usual: {usual:.2g} N)"
        return None


def changed(these: Levels, those: Levels, most_n: float) -> str | None:
    """Which sensor's force changed by more than noise and `MAX_HIDDEN_SHARE` of ``most_n``."""
    for name, (mean, error) in these.items():
        other, its_error = those[name]
        change_n = other - mean
        noise_n = MIN_STANDARD_ERRORS * math.hypot(error, its_error)
        if not abs(change_n) <= max(MAX_HIDDEN_SHARE * most_n, noise_n):
            return f"{name}: the force changed by {change_n:+.3f} N"
    return None


def unreleased(
    held: Levels, lifted: Levels, usual: Mapping[str, float], share: float
) -> str | None:
    """Which sensor's force stood still before and after a lift by a ``share`` of the way in; None
    if each fell, moved in the hold anyhow (``usual``: the standard errors of noise alone), or noise
    or steps (levels that are exact) would hide the fall.

    The deeper, the steeper: force falls by ``share`` of itself at least.
    """
    for name, (mean, error) in held.items():
        after, its_error = lifted[name]
        noise_n = MIN_STANDARD_ERRORS * math.hypot(error, its_error)
        fell_n, foretold_n = mean - after, share * mean
        still = 0 < error <= STILL * usual[name] and its_error > 0 and foretold_n > 2 * noise_n
        if still and abs(fell_n) <= max(FLAT * foretold_n, noise_n):
            return f"{name}: the force stayed at {mean:.3f} N, {fell_n:+.4f} N less,"
    return None


def no_force(levels: Levels, rates_hz: Mapping[str, float], most_n: float) -> str | None:
    """Says so if no sensor measures a force that its own noise does not explain; else None.

    A level of fewer than two readings (NaN) says nothing. Nor is what `little` says of the limit
    ``most_n`` a force if single readings do not show it: `press_guard` could not decide whether it
    rose with the depth, so a sensor that clips there would be believed.
    """

    def least_n(name: str, error: float) -> float:
        one_reading = error * math.sqrt(LEVEL_S * rates_hz[name])
        faint = min(NOISE_SIGMAS * one_reading, LITTLE_SHARE * most_n)
        return max(MIN_STANDARD_ERRORS * error, faint)

    if not levels or any(not mean <= least_n(name, err) for name, (mean, err) in levels.items()):
        return None
    values = ", ".join(f"{name} {mean:.3g} N" for name, (mean, _) in levels.items())
    return f"no force above the noise ({values})"


def little(levels: Levels, most_n: float) -> str | None:
    """Says so if every sensor measures less than `LITTLE_SHARE` of the limit ``most_n``.

    Tissue may be as soft as that; but a sensor that clips there says the same on any tissue.
    """
    if not levels or not all(mean < LITTLE_SHARE * most_n for mean, _ in levels.values()):
        return None
    values = ", ".join(f"{name} {mean:.3g} N" for name, (mean, _) in levels.items())
    return (
        f"{values} in a hold, at max_force_n = {most_n:g}: such a limit does not protect tissue as "
        "soft as that, and a sensor that clips would say the same on any; lower "
        "safety.max_force_n, and try the sensor with a weight"
    )
