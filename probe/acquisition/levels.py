"""Levels of force: what a sensor says at rest, and whether two of them are the same."""

import math
from collections.abc import Mapping

LEVEL_S = 0.1  # a level is the mean force over this long
HIDDEN = 0.1  # share of the force limit that a tare may hide at most
SURE = 6.0  # standard errors that tell two levels apart: once in 500 million by chance

Levels = Mapping[str, tuple[float, float]]  # sensor -> mean force [N] and its standard error


def changed(these: Levels, those: Levels, most_n: float) -> str | None:
    """Which sensor's force is another by more than noise and `HIDDEN` of ``most_n``; else None."""
    for name, (mean, error) in these.items():
        other, its_error = those[name]
        change_n = other - mean
        if not abs(change_n) <= max(HIDDEN * most_n, SURE * math.hypot(error, its_error)):
            return f"{name}: the force changed by {change_n:+.3f} N"
    return None


def nothing_felt(levels: Levels) -> str | None:
    """Says so if no sensor feels a push that its own noise does not explain; else None.

    A level of fewer than two readings (NaN) says nothing.
    """
    if not levels or any(not mean < SURE * error for mean, error in levels.values()):
        return None
    said = ", ".join(f"{name} {mean:.3g} N" for name, (mean, _) in levels.items())
    return f"nothing is felt that pushes back ({said})"
