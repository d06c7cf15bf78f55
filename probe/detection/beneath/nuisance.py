"""What nobody knows of surface, zero and relaxation, in a row's logarithms of force.

What relaxes takes the same share of all presses at one depth. A surface that is higher than the rig
takes it to be makes a press deeper: where a force is as the power p of depth d, a height h adds
p log(1 + h / d), which is made linear about the ``heights`` that a fit leaves over.
"""

from typing import NamedTuple

import numpy as np

from drivers.core.arrays import Array
from probe.detection.beneath.row_data import RowData
from probe.detection.priors import Priors

WAVES_M = 5e-3
"""How far apart heights of a wavy surface are alike, as a Gaussian: sines of 10 to 30 mm are so."""


class Nuisance(NamedTuple):
    """Covariance (n d, n d) of the logarithms of forces (n, d), raveled; what heights about which
    they were made linear add to these beside it (n d,); and what heights (n,) follow from residuals
    (n d,), before their own covariance is inverted."""

    covariance: Array
    shift: Array
    of_heights: Array


def nuisance(
    data: RowData, priors: Priors, power: Array, heights_m: Array | None = None
) -> Nuisance:
    """About ``heights_m`` (n,); none are known by default, and what a straight line leaves out is
    noise. ``power`` (n, d): that of the depth which the bare block's force is as."""
    force, (count, depths) = data.force_n, data.force_n.shape
    alike = _alike(data, priors)
    about_m = np.zeros((count, 1)) if heights_m is None else heights_m[:, None]
    deep_m = np.maximum(data.sunk_m + about_m, 0.2 * data.sunk_m)
    steep = (power / deep_m).ravel()
    shift = (power * np.log(deep_m / data.sunk_m)).ravel() - steep * np.repeat(about_m, depths)
    columns = [
        1e-3 * priors.zero_mn / force,
        *(priors.relaxation * np.ones_like(force) * (np.arange(depths) == k)
          for k in range(depths)),
    ]  # fmt: skip
    known = np.array([column.ravel() for column in columns]).T
    place = np.repeat(np.arange(count), depths)
    covariance = known @ known.T + np.outer(steep, steep) * alike[np.ix_(place, place)]
    if heights_m is None:
        # the root mean square of h^2 is sqrt(3) times h's variance
        curved = 0.5 * np.sqrt(3) * steep * np.diag(alike)[place] / np.tile(data.sunk_m, count)
        covariance += np.diag(curved**2)
    return Nuisance(covariance, shift, alike[:, place] * steep)


def _alike(data: RowData, priors: Priors) -> Array:
    """Covariance (n, n) of the heights [m^2]."""
    x_m = data.x_m - data.x_m.mean()
    half_m = max(float(np.abs(x_m).max()), 1e-6)
    waves = np.exp(-0.5 * ((x_m[:, None] - x_m) / WAVES_M) ** 2)
    tilt_m = 1e-3 * priors.tilt_mm_per_m * x_m
    bow_m = 1e-3 * priors.bow_mm * (x_m / half_m) ** 2
    return np.asarray(
        np.outer(tilt_m, tilt_m) + np.outer(bow_m, bow_m) + (1e-3 * priors.height_mm) ** 2
        + (1e-3 * priors.waves_mm) ** 2 * waves
        + (1e-3 * priors.repeatability_mm) ** 2 * np.eye(len(x_m))
    )  # fmt: skip
