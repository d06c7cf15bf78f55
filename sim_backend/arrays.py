"""The array types of this package."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Singles = NDArray[np.float32]
Blocks = NDArray[np.floating[Any]]
"""Element matrices (m, d, d), in single or double precision."""
