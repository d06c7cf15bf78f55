"""What a stage refuses to do: targets out of bounds or beside its axes, and too much speed."""

from collections.abc import Container

from drivers.core.errors import DeviceFault
from drivers.core.protocols import Pose

Limits = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
AXES = "xyz"
ROUNDING_MM = 1e-6  # of a file's millimetres, made metres and back
STILL_MM = 1e-6  # a way this short is rounding: a microstep of the finest screws is 10 nm


def outside(limits_mm: Limits | None, target: Pose) -> str | None:
    """Which axis of a target is out of bounds, and what is allowed; None if none is."""
    for axis, at, (low, high) in zip(AXES, target[:3], limits_mm or (), strict=False):
        if not low - ROUNDING_MM <= 1e3 * at <= high + ROUNDING_MM:  # also not-a-number
            return f"{axis} = {1e3 * at:g} mm; allowed: {low:g} to {high:g} mm"
    return None


def check_target(name: str, limits_mm: Limits | None, target: Pose) -> None:
    """Raises `DeviceFault` for a target out of bounds."""
    if (why := outside(limits_mm, target)) is not None:
        raise DeviceFault(name, why)


def check_speed(name: str, max_speed_mm_s: float, speed_m_s: float) -> None:
    """Raises `DeviceFault` for a speed that the stage is not to have."""
    if not 0 < 1e3 * speed_m_s <= max_speed_mm_s * (1 + 1e-9):  # also not-a-number
        raise DeviceFault(
            name,
            f"speed {1e3 * speed_m_s:g} mm/s; allowed: above 0 up to max_speed_mm_s = "
            f"{max_speed_mm_s:g}",
        )


def check_upright(name: str, target: Pose) -> None:
    """Raises `DeviceFault` for a target that only a stage which turns the tool can reach."""
    if any(target[3:]):
        raise DeviceFault(name, "has no axes to tilt the probe")


def check_way(name: str, axes: Container[str], here: Pose, target: Pose) -> None:
    """Raises `DeviceFault` for a way along an axis that is not among ``axes``."""
    for axis, from_m, to_m in zip(AXES, here, target, strict=False):
        if axis not in axes and abs(to_m - from_m) > 1e-3 * STILL_MM:
            raise DeviceFault(name, f"{axis} = {1e3 * to_m:g} mm: there is no {axis} axis")
