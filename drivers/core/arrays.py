"""The array types of every room above: the finite elements and the calibrations, which stand
alone, name their own."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
