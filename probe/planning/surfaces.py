"""The height of a surface over x and y: a level, a plane, or a smooth sheet through points."""

from collections.abc import Callable, Sequence

import numpy as np

from drivers.core.arrays import Array

Surface = Callable[[float, float], float]
Point = tuple[float, float, float]


def flat(_x_m: float, _y_m: float) -> float:
    """The surface z = 0."""
    return 0.0


def level(height_m: float) -> Surface:
    """The same height everywhere."""
    return lambda _x, _y: height_m


def through(points_m: Sequence[Point]) -> Surface:
    """The plane through three points [m]; through more, a thin-plate spline (Duchon 1977).

    Raises `ValueError` if the points lie on one line.
    """
    points = np.array(points_m, float)
    if len(points) == 3:
        return _plane(points)
    from scipy.interpolate import RBFInterpolator  # costs a quarter of a second to import

    try:
        sheet = RBFInterpolator(points[:, :2], points[:, 2], kernel="thin_plate_spline", degree=1)
    except np.linalg.LinAlgError:
        raise ValueError("the points must not lie on one line") from None
    return lambda x, y: float(sheet(np.array([[x, y]]))[0])


def _plane(points: Array) -> Surface:
    """The plane through three points (3, 3) [m]."""
    (x0, y0, z0), to_second, to_third = points[0], points[1] - points[0], points[2] - points[0]
    east, north, up = np.cross(to_second, to_third).tolist()
    if abs(up) <= 1e-9 * np.linalg.norm(to_second) * np.linalg.norm(to_third):
        raise ValueError("the points must not lie on one line")
    return lambda x, y: float(z0 - (east * (x - x0) + north * (y - y0)) / up)
