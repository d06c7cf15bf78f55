"""How far an object has moved sideways under a press, which widens the interval of its place.

A block that slides on its support is fixed at its middle, and a probe squeezes everything beneath
it away from there; one that is bonded to its support hardly moves. Which of the two a scan is of is
seldom known, so that a place's interval reaches inwards by what a sliding block may have moved.
"""

from drivers.core.arrays import Array

SQUEEZED = 0.7
"""Over the depth of the press. Of 89 rows over whole solved blocks (benchmarks/other_phantoms.py,
seeds below 36) 95 % of the places lie no further inwards of the fitted interval; it was not fitted
to the others. The median is 0.5."""
NEAR_MIDDLE = 0.3
"""Of half the block: nearer to the middle the shift falls to nothing. Its mean over the depth there
is 0.10, 0.36 and 0.55 in the first, second and third tenth, and 0.6 from there on."""


def reach_inwards_m(x_m: float, row_m: Array, depth_m: float) -> float:
    """How much nearer to the middle of a row at ``row_m`` (n,) one found at ``x_m`` may lie [m].

    The block is taken to end a pitch beyond the row; 0 where the ``depth_m`` of the presses is not
    known. Negative where inwards is towards smaller x.
    """
    middle, half = (row_m[0] + row_m[-1]) / 2, (row_m[-1] - row_m[0]) / 2
    half += (row_m[-1] - row_m[0]) / max(len(row_m) - 1, 1)
    share = float((middle - x_m) / half / NEAR_MIDDLE)
    return SQUEEZED * depth_m * min(max(share, -1.0), 1.0)
