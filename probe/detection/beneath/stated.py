"""The numbers that a posterior of what lies beneath states, and why it does not state others."""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc

from probe.detection.beneath.hypotheses import Bodies, Likelihood
from probe.detection.beneath.posterior import Posterior
from probe.detection.sizes import UNITS, Sizes, unknown

KNOWN = 0.5
"""Half of an interval over its middle, up to which a length or modulus has a value beside it."""
WORST = 0.01
"""Chance of a greater misfit, below which the body in the table is not what lies there."""
MIN_EFFECTIVE = 100.0
"""Effective points of a posterior whose 95 % interval is stated; with 100 its ends scatter
by a tenth of its width."""
AT_THE_END = 0.5
"""Density of a marginal at an end of its range over its greatest, from which that end is the
range's and not the data's."""
BINS = 10
SHOWN = {"_m": (1e3, " mm"), "_pa": (1e-3, " kPa")}
ONE_ROW = (
    "one row cannot tell a narrowing from a stiff wall: scan a second row over a healthy stretch "
    "of the same vessel"
)


class Misfit(NamedTuple):
    """Bodies in an even block leave more of what was measured unexplained than chance would."""

    chi2: float
    freedom: int


def misfit_of(posterior: Posterior, count: int) -> Misfit | None:
    """That of a posterior of ``count`` measured numbers, if it is more than chance's."""
    freedom = count - len(posterior.best)
    return Misfit(posterior.chi2, freedom) if chdtrc(freedom, posterior.chi2) < WORST else None


def sizes(
    bodies: Bodies, n: int, posterior: Posterior | Misfit, likelihood: Likelihood,
    rows: int = 1,
) -> Sizes:  # fmt: skip
    """What ``rows`` rows say of their ``n``-th body; a second one is over the same vessel where it
    is open."""
    if isinstance(posterior, Misfit):
        return unknown(why_unknown(posterior))
    if posterior.effective < MIN_EFFECTIVE:
        return unknown("its posterior could not be sampled well enough to state intervals")

    def of(name: str) -> Any:
        return posterior.points[:, bodies.column(n, name)]

    half_width_m, beats = likelihood.half_width_m, bodies.kinds[n].beats
    diameter = "log_inner" if beats else "log_diameter"
    values = {
        "depth": ("depth", half_width_m * of("depth")),
        "diameter": (diameter, half_width_m * np.exp(of(diameter))),
        "modulus": ("log_ratio", np.exp(posterior.points[:, 0] + of("log_ratio"))),
    }
    if beats and rows > 1:
        values["stenosis"] = ("narrowing", of("narrowing"))
    ranges = bodies.ranges(likelihood.x, likelihood.priors)
    said: dict[str, Any] = {}
    why = {"stenosis": ONE_ROW} if beats and rows == 1 else {}
    for name, (parameter, value) in values.items():
        at, unit = bodies.column(n, parameter), UNITS[name]
        lower, middle, upper = posterior.quantiles(value)
        from_low, from_high = _ends(posterior, at, *ranges[:, at])
        bounds = (-np.inf if from_low else float(lower), np.inf if from_high else float(upper))
        if from_low and from_high:
            why[name] = "what was scanned does not tell it"
            continue
        if unit and not (from_low or from_high) and (upper - lower) / 2 > KNOWN * middle:
            per, said_unit = SHOWN[unit]
            why[name] = f"known only from {per * lower:.3g} to {per * upper:.3g}{said_unit}"
        said[f"{name}_ci{unit}"] = bounds
        if name not in why and np.isfinite(bounds).all():
            said[name + unit] = float(middle)
    return Sizes(**said, undecided=why)


def why_unknown(misfit: Misfit) -> str:
    """What a misfit of the likeliest hypothesis means."""
    return (
        f"no one or two bodies in an even block explain this row (misfit {misfit.chi2:.0f} of "
        f"{misfit.freedom}): more objects, layers, a bone, or another support"
    )


def _ends(posterior: Posterior, at: int, low: float, high: float) -> tuple[bool, bool]:
    """Whether the lower and the upper end of a parameter's range are what bounds it."""
    density, _ = np.histogram(
        posterior.points[:, at], bins=BINS, range=(low, high), weights=posterior.weights
    )
    first, *_, last = density > AT_THE_END * density.max()
    return bool(first), bool(last)
