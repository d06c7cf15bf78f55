"""What the taxels of an array are called: ``r0c0``, ``r0c1``, … row by row."""

import re
from collections.abc import Sequence

import numpy as np

from drivers.core.arrays import Ints

NAME = re.compile(r"r(\d{1,4})c(\d{1,4})")


def taxel_names(rows: int, columns: int) -> list[str]:
    """The channels' names of a whole array."""
    return [f"r{row}c{column}" for row in range(rows) for column in range(columns)]


def taxel_places(names: Sequence[str]) -> Ints | None:
    """Row and column (n, 2) of taxels by their names; None where one does not say it, where two say
    the same, and of none.

    Examples
    --------
    >>> taxel_places(["r0c0", "r1c2"]).tolist()
    [[0, 0], [1, 2]]
    >>> taxel_places(["force"]) is None
    True
    """
    named = [NAME.fullmatch(name) for name in names]
    places = [(int(one[1]), int(one[2])) for one in named if one]
    if not places or len(set(places)) < len(names):
        return None
    return np.array(places, np.int64)
