"""Warnings about a fitted calibration: where its model does not fit the readings."""

import numpy as np

from calibration import (
    Calibration,
    ComplianceCalibration,
    ForceCalibration,
    TaxelCalibration,
)
from calibration.fit import outlier
from drivers.core.arrays import Array, Bools

STRAIGHT = 0.02
"""Share of the span. A sensor that clips at the highest of four loads is 16 % off and its gain 14
%, while the 95 % interval allows 11; a straight one with 0.07 % of noise is 0.04 % off."""

HARD_LUMP_N_M = 10e3
"""Of what may lie in tissue (docs/explanation/safety.md): a rigid block gives way less."""

SHOWN = 6  # columns by name: a line of a terminal


def doubts(result: Calibration) -> tuple[str, ...]:
    """Each in a sentence, with what to do."""
    match result:
        case ForceCalibration():
            return _of_force(result)
        case TaxelCalibration():
            return _of_taxels(result)
        case ComplianceCalibration():
            return _of_rig(result)
        case _:
            return ()


def _of_force(result: ForceCalibration) -> tuple[str, ...]:
    channels, fit = len(result.sensitivity), result.fit
    each = zip(np.split(fit.residuals, channels), np.split(fit.leverage, channels), strict=True)
    for channel, (residuals, leverage) in enumerate(each):
        if (row := outlier(residuals, leverage, len(fit.values) // channels)) is not None:
            return (
                f"reading {row + 1} of raw_{channel} is far from the line through the others: was "
                "it mistyped, or the load another? Correct it or leave it out",
            )
    if result.linearity > STRAIGHT:
        return ("no straight line fits these readings: does the sensor clip?",)
    return ()


def _of_rig(result: ComplianceCalibration) -> tuple[str, ...]:
    found = []
    if result.stiffness_n_m < HARD_LUMP_N_M:
        way_mm = 1e3 * result.force_max_n / result.stiffness_n_m
        found.append(
            f"the rig gives way by {way_mm:.2g} mm at {result.force_max_n:.3g} N, softer than a "
            f"hard lump in tissue ({1e-3 * HARD_LUMP_N_M:g} N/mm): was the block rigid, and are "
            "all screws tight?"
        )
    if result.bend:
        found.append(_of_bend(result))
    return tuple(found)


def _of_bend(result: ComplianceCalibration) -> str:
    start, end = result.stiffness_start_n_m, result.stiffness_end_n_m
    return (
        f"the rig {'stiffens' if end > start else 'softens'}: from {start:.4g} N/m at the touch to "
        f"{end:.4g} at {result.force_max_n:.3g} N, {100 * abs(result.bend):.2g} % of the "
        f"{result.stiffness_n_m:.4g} that a scan takes for all loads, which puts its depths off by "
        f"up to {1e3 * result.depth_off_m:.2g} mm. Press the block no harder than your scans do, "
        "and look for play or something soft in the mounting"
    )


def _of_taxels(result: TaxelCalibration) -> tuple[str, ...]:
    found = []
    if (still := np.isfinite(result.dead_zone_pa)).any():
        found.append(
            f"readings of {_columns(still)} stand still up to {_kpa(result.dead_zone_pa[still])} "
            "and were left out there; in a scan pressures read too low by as much: load the array "
            "beforehand, or exchange it"
        )
    if (clips := np.isfinite(result.clips_pa)).any():
        found.append(
            f"readings of {_columns(clips)} stand still from {_kpa(result.clips_pa[clips])} on and "
            "were left out there; a scan marks such readings as saturated: press less than that"
        )
    if (bent := result.bent > 0).any():
        found.append(
            f"no straight line fits {_columns(bent)}, off it by up to "
            f"{100 * result.bent.max():.2g} % of the span: leave out pressures at which readings "
            "hardly change, or calibrate over the pressures of your scans alone"
        )
    return tuple(found)


def _columns(which: Bools) -> str:
    """The table's columns of these taxels."""
    names = [f"raw_{n}" for n in np.flatnonzero(which)]
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _kpa(pressures: Array) -> str:
    low, high = 1e-3 * pressures.min(), 1e-3 * pressures.max()
    return f"{low:.3g} kPa" if high - low < 0.01 * abs(high) else f"{low:.3g} to {high:.3g} kPa"
