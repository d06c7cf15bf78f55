"""Where a press first touched: the contact point of a force curve, whatever the shape below.

F = F0 + a max(d - contact, 0)^m,   1 <= m <= 2 (flat face to cone)
"""

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, as_columns, nonlinear_fit, same_length

ADVICE = "begin above the surface, and press until the force is well above its noise"
POWERS = (0.5, 3.0)  # a flat face has 1, a sphere 1.5, a cone 2
FITTED_FORCE_SHARE = 0.35  # of the greatest force: up to there the curve is looked at


def find_contact(travel_m: Array, force_n: Array) -> Fit:
    """The travel (growing inwards) [m] at which the force begins; ``values[0]`` is it.

    ``travel_m`` (n,), ``force_n`` (n,) of one approach. The zero is the force's level in the air.
    Raises `CalibrationError` without readings in the air, or without a force.
    """
    travel, force = as_columns(travel_m, "travel", 1)[:, 0], as_columns(force_n, "force", 1)[:, 0]
    same_length(travel=travel, force=force)
    if len(travel) < 12 or np.ptp(travel) == 0:
        raise CalibrationError(f"{len(travel)} readings of one approach are too few; {ADVICE}")
    order = np.argsort(travel, kind="stable")
    travel, force = travel[order], force[order]
    noise = 1.4826 * float(np.median(np.abs(np.diff(force)))) / np.sqrt(2)
    end = len(force) // 20 + 3
    first, last = float(np.mean(force[:end])), float(np.mean(force[-end:]))
    if last - first < 40 * noise / np.sqrt(len(force)) or last <= first:
        raise CalibrationError(f"the force rises by {last - first:.3g} N only; {ADVICE}")
    far = force > first + max(FITTED_FORCE_SHARE * (last - first), 30 * noise)
    near = len(force) - int(np.argmin(far[::-1])) if far.any() else len(force)
    travel, force = travel[:near], force[:near]  # deep down the power is another one
    size, span = float(np.mean(force[-end:])) - first, float(np.ptp(travel))
    half = force > first + 0.5 * size
    if not half.any() or np.ptp(travel[half]) == 0:
        raise CalibrationError(f"the force rises between two readings; {ADVICE}, slowly")
    slope, level = np.polyfit(travel[half], force[half], 1)
    start = float(np.clip((first - level) / slope, travel[0] + 0.02 * span, travel[-1]))

    def model(p: Array) -> Array:
        sunk = np.maximum(travel - start - span * p[0], 0.0) / span
        return np.asarray(p[3] + np.exp(p[1]) * sunk ** np.clip(p[2], *POWERS))

    scale = size / ((travel[-1] - start) / span) ** 1.2
    fit = nonlinear_fit(
        lambda p: model(p) - force / size,
        np.array([0.0, np.log(scale / size), 1.2, first / size]),
        ("contact", "log rise", "power", "zero"),
        ADVICE,
        weakest=1e-6,
    )
    contact = start + span * float(fit.values[0])
    if (travel < contact).sum() < 3:
        raise CalibrationError(f"the probe was in contact from the beginning; {ADVICE}")
    return fit.derived(("contact",), np.array([contact]), np.array([[span, 0.0, 0.0, 0.0]]))
