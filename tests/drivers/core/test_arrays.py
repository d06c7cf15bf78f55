"""Columns that lie side by side are picked by a slice, and are the same ones."""

import numpy as np
import pytest

from drivers.core.arrays import columns_of


@pytest.mark.parametrize("numbers", [[0], [1, 2, 3], [0, 2], [2, 1], [1, 1], []], ids=str)
def test_the_same_columns_are_picked(numbers: list[int]) -> None:
    values = np.arange(20.0).reshape(4, 5)
    picked = columns_of(numbers)
    assert isinstance(picked, slice) is (numbers in ([0], [1, 2, 3]))
    assert values[:, picked].tolist() == values[:, numbers].tolist()
