"""Compliance of the rig itself, from presses on a rigid block.

The stage goes on after contact while the block does not, so force = k (travel - contact), and on
tissue the true indentation is the commanded one less force / k.
"""

from contextlib import suppress
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import (
    Array,
    Fit,
    as_columns,
    correlated,
    linear_fit,
    nonlinear_fit,
    same_length,
)

ADVICE = "press the rigid block further, in steps, up to the largest force of your scans"
FALSE_BEND = 1e-3  # chance that a straight rig is said to bend; see `_bend`
BEND = 0.02  # of the stiffness, over the range: within 1 % of it all the way is what is aimed at
MIN_LOAD_SHARE = 0.3  # of the greatest force: from there on a reading is one under load


@dataclass(frozen=True)
class ComplianceCalibration:
    """``stiffness_n_m``; ``curvature`` is the relative bend of the curve over the loads used.

    Beyond ``force_max_n`` the stiffness was not measured. Where the curve bends clearly, the
    stiffness is ``stiffness_start_n_m`` at the touch and ``stiffness_end_n_m`` at the deepest
    reading; otherwise both are ``stiffness_n_m``. They are NaN from files that lack them.
    """

    KIND: ClassVar[str] = "compliance"
    UNITS: ClassVar[dict[str, str]] = {
        "stiffness_n_m": "N/m",
        "contact_m": "m",
        "force_max_n": "N",
        "curvature": "1",
        "stiffness_start_n_m": "N/m",
        "stiffness_end_n_m": "N/m",
    }
    ADDED: ClassVar[tuple[str, ...]] = ("stiffness_start_n_m", "stiffness_end_n_m")
    stiffness_n_m: float
    contact_m: float
    force_max_n: float
    curvature: float
    stiffness_start_n_m: float
    stiffness_end_n_m: float
    fit: Fit = field(repr=False)

    @property
    def bend(self) -> float:
        """How much stiffer the rig is at the largest force than at the touch, of its stiffness; 0
        where it does not bend clearly."""
        return (self.stiffness_end_n_m - self.stiffness_start_n_m) / self.stiffness_n_m

    @property
    def depth_off_m(self) -> float:
        """The most by which force / stiffness is off what the bent curve gives way [m]."""
        start, end = self.stiffness_start_n_m, self.stiffness_end_n_m
        way = np.linspace(0, 2 * self.force_max_n / (start + end), 101)
        force = start * way + (end - start) * way**2 / (2 * way[-1])
        return float(np.abs(way - force / self.stiffness_n_m).max())

    def misses(self, depth_m: Array, force_n: Array) -> Array:
        """Forces under load less the expected ones (n,) [N], wherever contact began."""
        force = np.asarray(force_n, dtype=float)
        loaded = force > force.min() + MIN_LOAD_SHARE * np.ptp(force)
        off = force[loaded] - self.stiffness_n_m * np.asarray(depth_m)[loaded]
        return np.asarray(off - off.mean())


def fit_compliance(depth_m: Array, force_n: Array) -> ComplianceCalibration:
    """Rig stiffness from travel (n,) [m, down positive] and force (n,) [N] on a rigid block.

    The model is the hinge F = F0 + k max(d - d0, 0), so points in the air help and no point has
    to be chosen by its own noisy force. Raises `CalibrationError` without load variation.
    """
    depth, force = as_columns(depth_m, "depth_m", 1)[:, 0], as_columns(force_n, "force_n", 1)[:, 0]
    same_length(depth_m=depth, force_n=force)
    order = np.argsort(depth, kind="stable")
    depth, force = depth[order], force[order]
    if len(depth) < 6 or np.ptp(depth) == 0:
        raise CalibrationError(f"{len(depth)} readings at too few depths; {ADVICE}")
    noise = 1.4826 * float(np.median(np.abs(np.diff(force, 2)))) / np.sqrt(6)
    low, high = float(force.min()), float(force.max())
    if high - low < 20 * noise or high == low:
        raise CalibrationError(
            f"the force varies by {high - low:.3g} N, no more than noise; {ADVICE}"
        )
    upper = force > low + MIN_LOAD_SHARE * (high - low)
    if len(np.unique(depth[upper])) < 3:
        raise CalibrationError(f"fewer than three loaded depths; {ADVICE}")
    slope, level = np.polyfit(depth[upper], force[upper], 1)
    if slope <= 0:
        raise CalibrationError(
            "the force falls with depth: depths must grow downwards, and pressed is positive"
        )
    contact = (low - level) / slope
    air = bool((depth < contact).sum() >= 3)
    if air:
        fit = _hinge(
            depth, force, np.array([slope, contact, float(np.median(force[depth < contact]))])
        )
    else:  # all in contact: the zero must be trusted
        middle = float(depth.mean())
        design = np.column_stack([depth - middle, np.ones(len(depth))])
        line = correlated(linear_fit(design, force, ("k", "F"), ADVICE), design)
        k, f = line.values
        fit = line.derived(
            ("stiffness", "contact"),
            np.array([k, middle - f / k]),
            np.array([[1, 0], [f / k**2, -1 / k]]),
        )
    stiffness, contact = float(fit.values[0]), float(fit.values[1])
    pressed = depth > contact
    bend = np.polyfit((depth[pressed] - contact) / np.ptp(depth[pressed]), force[pressed], 2)
    start, end = _bend(depth, force, stiffness, contact)
    return ComplianceCalibration(
        stiffness, contact, high, float(bend[0] / abs(bend[1])), start, end, fit
    )


def _hinge(depth: Array, force: Array, start: Array) -> Fit:
    """Stiffness, contact and zero of readings that begin in the air."""

    def misfit(p: Array) -> Array:
        return np.asarray(p[2] + p[0] * np.maximum(depth - p[1], 0) - force)

    def slopes(p: Array) -> Array:
        deep = depth > p[1]
        return np.column_stack(
            [np.where(deep, depth - p[1], 0), np.where(deep, -p[0], 0), np.ones(len(depth))]
        )

    names = ("stiffness", "contact", "zero")
    fit = nonlinear_fit(misfit, start, names, ADVICE, jacobian=slopes)
    return correlated(fit, slopes(fit.values))


def _bend(depth: Array, force: Array, stiffness: float, contact: float) -> tuple[float, float]:
    """Stiffness at the touch and at the deepest reading, by F = F0 + k x + c x^2 with x the travel
    since the touch; twice ``stiffness`` where c is not clearly other than 0 (Student's t).

    Whether readings begin in the air is decided by Schwarz' criterion (1978, Ann. Stat. 6, 461).
    Of 300 straight rigs each, of 8 to 1000 readings with noise of 0.1 or 2.5 % of the force, 1 % or
    fewer are said to bend; at a lag-one correlation of 0.9 and 2.5 % up to 6 %.
    """
    from scipy.special import stdtrit

    names = ("zero", "stiffness", "bend", "contact")

    def slopes(p: Array) -> Array:
        x = depth - depth[0] if len(p) < len(names) else np.maximum(depth - p[3], 0)
        rows = [np.ones(len(x)), x, x**2, np.where(x > 0, -p[1] - 2 * p[2] * x, 0)]
        return np.column_stack(rows[: len(p)])

    fits = []
    for count in (3, 4):
        first = np.array([force[0], stiffness, 0.0, contact])[:count]
        with suppress(CalibrationError):  # too few readings, in the air or under load
            fits.append(
                nonlinear_fit(
                    lambda p: slopes(p)[:, :3] @ p[:3] - force,
                    first,
                    names[:count],
                    ADVICE,
                    jacobian=slopes,
                )
            )
    if not fits:
        return stiffness, stiffness

    def criterion(fit: Fit) -> float:
        misfit = len(force) * np.log(max(fit.rms, 1e-150) ** 2)
        return float(misfit + len(fit.values) * np.log(len(force)))

    best = min(fits, key=criterion)
    best = correlated(best, slopes(best.values))
    k, c = float(best.values[1]), float(best.values[2])
    touch = best.values[3] if len(best.values) == len(names) else depth[0]
    change = 2 * c * float(depth[-1] - touch)
    clear = abs(c) > stdtrit(best.dof, 1 - FALSE_BEND / 2) * float(best.sigma[2])
    return (k, k + change) if clear and abs(change) > BEND * stiffness else (stiffness, stiffness)
