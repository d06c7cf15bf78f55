"""A stage's key ``limits_mm``: bounds of its targets in the scan frame."""

from drivers.core.errors import DeviceFault
from drivers.core.protocols import Pose

Limits = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
ROUNDING_MM = 1e-6  # of a file's millimetres, made metres and back


def outside(limits_mm: Limits | None, target: Pose) -> str | None:
    """Which axis of a target is out of bounds, and what is allowed; None if none is."""
    for axis, at, (low, high) in zip("xyz", target[:3], limits_mm or (), strict=False):
        if not low - ROUNDING_MM <= 1e3 * at <= high + ROUNDING_MM:  # also not-a-number
            return f"{axis} = {1e3 * at:g} mm; allowed: {low:g} to {high:g} mm"
    return None


def check_target(name: str, limits_mm: Limits | None, target: Pose) -> None:
    """Raises `DeviceFault` for a target out of bounds."""
    if (why := outside(limits_mm, target)) is not None:
        raise DeviceFault(name, why)
