"""Whether a table's numbers can be in the units that its columns name, before anything is fitted.

A thousand times too much or too little fits as well as what was meant, with as narrow an interval.
"""

from typing import NamedTuple

import numpy as np

from calibration.errors import CalibrationError
from drivers.core.arrays import Array
from probe.calibrate.measurements import Measurements
from probe.core.contact_stress import PRESSED_N

FULL_TURN_RAD = 2 * np.pi
SLOWEST_S = 1.0
"""Between two samples of a movement: a delay of less than 0.25 s is looked for."""


class Span(NamedTuple):
    """What columns of a kind may span together if they vary, in the unit of their names."""

    kinds: tuple[str, ...]
    columns: tuple[str, ...]
    least: float
    most: float
    unit: str


SPANS = (
    Span(("force",), ("load",), 0.02, PRESSED_N, "N"),
    Span(("gravity",), ("fx_n", "fy_n", "fz_n"), 0.0, PRESSED_N, "N"),
    Span(("gravity",), ("mx_nm", "my_nm", "mz_nm"), 0.0, 100.0, "Nm"),
    Span(("compliance", "tissue", "latency"), ("force_n",), 0.0, PRESSED_N, "N"),
    Span(("compliance", "tissue", "latency"), ("depth_mm",), 0.01, 50.0, "mm"),
    Span(("taxels",), ("pressure_pa",), 200.0, 1e7, "Pa"),
    Span(("surface",), ("x_mm", "y_mm"), 1.0, 2000.0, "mm"),
    Span(("axes", "tool"), ("x_mm", "y_mm", "z_mm"), 1.0, 2000.0, "mm"),
    Span(("axes",), ("true_x_mm", "true_y_mm", "true_z_mm"), 1.0, 2000.0, "mm"),
)
"""Forces: 2 g are less than presses are held to. Places: a UR20 reaches
1,750 mm; what is calibrated over less than a millimetre is not used. Depths: no press of this
package goes deeper than its block. Pressures: fingers press with some kPa; a table that means
kilopascals stays below 200."""


def check_units(kind: str, measured: Measurements) -> None:
    """Raises `CalibrationError` with the columns, what they span, and what is possible."""
    for one in SPANS:
        found = [str(name) for name in measured.table if str(name).startswith(one.columns)]
        if kind not in one.kinds or not found:
            continue
        span = max(float(np.ptp(column)) for name in found
                   if len(column := measured.filled(name)))  # fmt: skip
        if 0 < span < one.least or span > one.most:  # what never varies is its fit's to refuse
            raise CalibrationError(
                f"{measured.path}: {_named(found)}: {span:.3g} {one.unit} between the least and "
                f"the greatest; {one.least:g} to {one.most:g} are possible. Are they in {one.unit}?"
            )
    if kind in ("gravity", "tool"):
        _check_turns(measured)
    if kind == "latency":
        for name in ("time_s", "sensor_time_s"):
            _check_rate(measured, name)


def _named(columns: list[str]) -> str:
    return f"column{'s' * (len(columns) > 1)} {', '.join(columns)}"


def _check_turns(measured: Measurements) -> None:
    turns = measured.columns("rx_rad", "ry_rad", "rz_rad")
    largest = float(np.linalg.norm(turns, axis=1).max(initial=0.0))
    if largest > FULL_TURN_RAD:
        raise CalibrationError(
            f"{measured.path}: columns rx_rad, ry_rad, rz_rad: a rotation vector of {largest:.3g} "
            "rad is longer than a full turn; are they in degrees, or no rotation vectors?"
        )


def _check_rate(measured: Measurements, name: str) -> None:
    times: Array = measured.filled(name)[:, 0]
    step_s = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if step_s > SLOWEST_S:
        raise CalibrationError(
            f"{measured.path}: column {name}: a sample every {step_s:.3g} s, where {SLOWEST_S:g} s "
            "is the longest that shows a delay. Are they in seconds?"
        )
