"""A recording from elsewhere as numbers, whatever its file is, and which numbers are possible."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from drivers import Channel
from drivers.core.arrays import Array
from drivers.core.extras import needs
from drivers.core.protocols import MAX_RATE_HZ
from drivers.core.units import to_si
from probe.core.recording import FARTHEST_M

with needs("data", "palpate import"):
    import pandas as pd

SIGNALS = {
    "force_n": Channel("force", "N", "force"),
    "pressure_pa": Channel("pressure", "Pa", "pressure"),
    "pressure_mbar": Channel("pressure", "mbar", "pressure"),
}
DEVICE, TAXELS = "imported", "taxels"
"""What a run calls the device that the signal is of, and the array where both are there."""
PLACES = ("x_mm", "y_mm")
DEPTH = "depth_mm"
REFERENCE = "reference"
PER_STATION = (*PLACES, DEPTH)
ARRAYS = {"taxels_n": "N", "taxels_pa": "Pa", "taxels_counts": "counts"}
UNITS = (
    {"time_s": "s"}
    | {name: channel.unit for name, channel in SIGNALS.items()}
    | ARRAYS
    | dict.fromkeys(PER_STATION, "mm")
    | {"station": "", REFERENCE: ""}
)
"""What a column may be, and in which unit."""
PHASE = "phase_number"  # which of `Phase`, from 0
LARGEST = {
    "s": 2**52 / MAX_RATE_HZ,  # beyond, the times of the fastest sensor's samples are the same
    "N": 1e6,  # an FT-300, of all sensors here with the largest range, reads 300 N
    "Pa": 1e9,  # steel yields below
    "m": FARTHEST_M,
    "": 2.0**63,  # counts: no converter has more bits
}
FACE_MM2 = (1e-6, 1e6)
"""The least and the largest face of a probe: the tip of a force microscope, and a square metre."""


class CsvError(ValueError):
    """A recording that cannot be imported: the text names file, column, row and what is allowed."""


class Table(NamedTuple):
    """A recording's ``rows`` as numbers, NaN where nothing is there.

    Their columns: ``time_s``; `signal` and `saturated` of each channel of ``devices``, numbered
    through, in its unit; and of `PER_STATION`, ``station``, ``reference`` and `PHASE` those that
    are known. What has a rate of its own has NaN in the rows of the others.
    ``left_out`` names the columns not taken,
    ``face_mm2`` the probe's face where the file has it, ``sha256`` that of the file, ``notes`` what
    was lost or put in order, ``merged`` whether the rows are of several clocks.
    """

    rows: pd.DataFrame
    devices: Mapping[str, tuple[Channel, ...]]
    left_out: tuple[str, ...] = ()
    face_mm2: float | None = None
    sha256: str = ""
    notes: tuple[str, ...] = ()
    merged: bool = False


def signal(number: int) -> str:
    """The column of the readings of a channel."""
    return f"signal_{number}"


def saturated(number: int) -> str:
    """The column that is 1 where a channel clipped."""
    return f"saturated_{number}"


def check_size(values: Array, name: str, unit: str, first_row: int = 1) -> None:
    """Raises `CsvError`, naming column and row, for numbers (n,) that no device says."""
    base, factor = to_si(unit)
    largest = LARGEST.get(base, LARGEST[""]) / factor
    wrong = np.flatnonzero(np.abs(values) > largest)
    if len(wrong):
        raise CsvError(
            f"row {wrong[0] + first_row}, column {name!r}: {values[wrong[0]]:g}; "
            f"{-largest:g} to {largest:g} {unit}".rstrip()
            + " is allowed, and no device says more; is it in another unit?"
        )


def check_face(face_mm2: float | None, said_by: str) -> None:
    """Raises `CsvError`, naming who said it, for a face that no probe has."""
    if face_mm2 is not None and not FACE_MM2[0] <= face_mm2 <= FACE_MM2[1]:
        raise CsvError(
            f"{said_by} = {face_mm2:g}: must be from {FACE_MM2[0]:g} to {FACE_MM2[1]:g} mm2"
        )
