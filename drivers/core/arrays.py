"""The array types of every room above: the finite elements and the calibrations, which stand
alone, name their own."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def columns_of(numbers: list[int]) -> slice | list[int]:
    """What picks these columns of an array: a slice where they are side by side, which numpy looks
    up in a tenth of the time."""
    if numbers and numbers == list(range(numbers[0], numbers[-1] + 1)):
        return slice(numbers[0], numbers[-1] + 1)
    return numbers
