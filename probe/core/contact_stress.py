"""From the values of a device's channels to contact stress, the tactile signal."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers import Channel
from drivers.core.arrays import Array
from drivers.core.units import to_si, units_of
from probe.core.errors import RunFileError

FORCE_ROLES = ("force", "pressure", "taxel")
PRESSED_N = 500.0
"""More is no press of soft tissue: an FT-300, of all sensors here with the largest range, reads
300."""


def tactile_or_none(channels: Mapping[str, tuple[Channel, ...]]) -> str | None:
    """The device the signal is taken from: the first with a force, pressure or taxel channel."""
    feels = (d for d, own in channels.items() if any(c.role in FORCE_ROLES for c in own))
    return next(feels, None)


def tactile_device(channels: Mapping[str, tuple[Channel, ...]]) -> str:
    """As `tactile_or_none`. Raises `RunFileError` if there is none."""
    if (device := tactile_or_none(channels)) is None:
        raise RunFileError("no force, pressure or taxel channel: nothing was measured")
    return device


@dataclass(frozen=True)
class StressConversion:
    """Which columns of a device's values make the tactile signal, and Pa per unit of each.

    ``unit`` is that of the signal: Pa, or what was read where that is asked for and no stress.
    """

    columns: tuple[int, ...]
    pa_per_unit: Array
    unit: str = "Pa"

    def stress_pa(self, values: Array) -> Array:
        """Contact stress (n, columns) of ``values`` (n, channels)."""
        return np.asarray(values[:, list(self.columns)] * self.pa_per_unit)


def stress_conversion(
    channels: Sequence[Channel], face_m2: float, *, any_unit: bool = False
) -> StressConversion:
    """From a device's channels to contact stress: the one place where a recording's newtons become
    pascals.

    Forces go before pressures, these before taxels. A force is spread over ``face_m2``; taxels
    share it. Raises `RunFileError` for a force where ``face_m2`` is NaN, and for a unit that is
    neither a force nor a pressure, such as counts; with ``any_unit`` that one stays as it is.
    """
    role = next((r for r in FORCE_ROLES if any(c.role == r for c in channels)), None)
    columns = tuple(n for n, channel in enumerate(channels) if channel.role == role)
    units = {channels[n].unit for n in columns}
    if any_unit and len(units) == 1 and not units & {*units_of("N", "Pa")}:
        return StressConversion(columns, np.ones(len(columns)), units.pop())
    share = len(columns) if role == "taxel" else 1
    gains = [_pa_per_unit(channels[n], face_m2 / share) for n in columns]
    return StressConversion(columns, np.array(gains))


def _pa_per_unit(channel: Channel, area_m2: float) -> float:
    unit, factor = to_si(channel.unit)
    if unit == "Pa":
        return factor
    if unit != "N":
        raise RunFileError(
            f"channel {channel.name} is in {channel.unit!r}; a tactile signal is in one of "
            f"{', '.join(units_of('N', 'Pa'))}"
        )
    if math.isnan(area_m2):
        raise RunFileError("the probe's face is not known, so a force is no stress; give face_mm2")
    return factor / area_m2


def face_m2_of(config: Mapping[str, Any], face_mm2: float | None = None) -> float:
    """The probe's face [m2]: ``face_mm2``, or the run's, or NaN. Raises `RunFileError`."""
    said_by = "config.face_mm2" if face_mm2 is None else "face_mm2"
    face_mm2 = config.get("face_mm2") if face_mm2 is None else face_mm2
    if face_mm2 is not None and not (isinstance(face_mm2, int | float) and 0 < face_mm2 < math.inf):
        raise RunFileError(f"{said_by} = {face_mm2!r}: must be above 0, in mm2")
    face_m2 = square_metres(face_mm2)
    return math.nan if face_m2 is None else face_m2


def square_metres(face_mm2: float | None) -> float | None:
    """A face of ``face_mm2`` [m2]; None, a face that nobody knows, stays None."""
    return None if face_mm2 is None else 1e-6 * face_mm2


def simulated_channels(channels: Mapping[str, tuple[Channel, ...]]) -> tuple[str, ...]:
    """``device.channel`` of every simulated channel."""
    return tuple(f"{d}.{c.name}" for d, own in channels.items() for c in own if c.simulated)
