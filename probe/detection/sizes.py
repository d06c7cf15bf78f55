"""How deep, how large and how stiff an object is, with what is not known of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from typing import Any

import numpy as np

from probe.core.finding_words import NORMAL_95

Interval = tuple[float, float]


@dataclass(frozen=True)
class Sizes:
    """Numbers in SI units with their 95 % intervals, NaN where the data do not say; an infinite end
    is one that they do not bound. ``undecided`` says why, by name."""

    depth_m: float = nan
    depth_ci_m: Interval = (nan, nan)
    diameter_m: float = nan
    diameter_ci_m: Interval = (nan, nan)
    modulus_pa: float = nan
    modulus_ci_pa: Interval = (nan, nan)
    stenosis: float = nan
    stenosis_ci: Interval = (nan, nan)
    undecided: Mapping[str, str] = field(default_factory=dict)

    def spread(self, name: str) -> Interval | None:
        """Value and standard deviation [SI] of one of `NAMES`, by half of its interval; None where
        it is unknown."""
        value: float = getattr(self, name + UNITS[name])
        low, high = getattr(self, f"{name}_ci{UNITS[name]}")
        return None if np.isnan(value) else (value, (high - low) / (2 * NORMAL_95))

    def as_json(self) -> dict[str, Any]:
        """The contract of an object in ``detect --json``; a diameter is a vessel's inner one."""
        return {
            **_said("depth", "_mm", 1e3, self.depth_m, self.depth_ci_m),
            **_said("diameter", "_mm", 1e3, self.diameter_m, self.diameter_ci_m),
            **_said("modulus", "_kpa", 1e-3, self.modulus_pa, self.modulus_ci_pa),
            **_said("stenosis", "", 1.0, self.stenosis, self.stenosis_ci),
            "undecided": sorted(self.undecided),
            "undecided_because": dict(self.undecided),
        }


UNITS = {"depth": "_m", "diameter": "_m", "modulus": "_pa", "stenosis": ""}
"""How the field of each ends; a stenosis is a share of the lumen's diameter."""
NAMES = tuple(UNITS)


def unknown(why: str) -> Sizes:
    """Nothing is known of depth, size and stiffness."""
    return Sizes(undecided=dict.fromkeys(NAMES, why))


def _said(name: str, unit: str, per: float, value: float, ci: Interval) -> dict[str, Any]:
    low, high = (None if not np.isfinite(end) else per * end for end in ci)
    return {
        name + unit: None if np.isnan(value) else per * value,
        f"{name}_ci{unit}": None if low is None and high is None else [low, high],
    }
