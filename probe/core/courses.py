"""Where what was found lies on a grid's map: what window and report draw over it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drivers.core.arrays import Array


def courses_mm(found: Mapping[str, Any]) -> list[tuple[str, Array]]:
    """Where the objects of a finding's JSON lie on a grid's map: a name and points (k, 2) x, y [mm]
    of each. A vessel's stenosed stretch follows it, by a name of its own."""
    drawn = []
    for one in found["objects"]:
        if not (course := one.get("course_mm")):
            continue
        points = np.array(course, float)
        drawn.append((str(one["kind"]), points))
        if ends := one.get("stenosed_mm"):
            y_mm = points[:, 1]
            there = (y_mm > min(ends) - 1e-3) & (y_mm < max(ends) + 1e-3)
            drawn.append(("stenosed", points[there]))
    return drawn
