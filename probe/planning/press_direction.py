"""The direction of a press: in along the surface's normal, the tool turned to it."""

import math

from drivers import Pose
from probe.planning.surfaces import Point, Surface

SLOPE_M = 0.1e-3  # a slope is the difference of heights this far to either side


def normal_of(pose: Pose) -> Point:
    """Unit vector that a pose of `Plan.at_surface` presses against."""
    angle = math.hypot(pose.rx, pose.ry)
    if angle == 0.0:
        return (0.0, 0.0, 1.0)
    sine = math.sin(angle) / angle
    return (sine * pose.ry, -sine * pose.rx, math.cos(angle))


def pressed(surface: Pose, depth_m: float) -> Pose:
    """``depth_m`` further in along the normal."""
    x, y, z = normal_of(surface)
    return surface._replace(
        x=surface.x - depth_m * x, y=surface.y - depth_m * y, z=surface.z - depth_m * z
    )


def turn_at(surface: Surface, x_m: float, y_m: float) -> Point:
    """Rotation vector [rad] from straight down to the surface's normal at a place."""
    return _turn_to(_slope(surface, x_m, y_m))


def _slope(surface: Surface, x: float, y: float) -> tuple[float, float]:
    h = SLOPE_M
    east, west, north, south = (
        surface(x + i * h, y + j * h) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    return (east - west) / (2 * h), (north - south) / (2 * h)


def _turn_to(slope: tuple[float, float]) -> Point:
    """Rotation vector from straight down to the normal (-slope, 1)."""
    steep = math.hypot(*slope)
    if steep < 1e-9:  # rounding of a level surface
        return (0.0, 0.0, 0.0)
    angle = math.atan(steep)
    return (angle * slope[1] / steep, -angle * slope[0] / steep, 0.0)
