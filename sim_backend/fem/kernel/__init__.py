"""The hot loops of the finite elements in C, where they were built; elsewhere numpy does the same.

Who uses one of them asks for `BUILT` and has the same in numpy or scipy beside it. Arrays are
contiguous, of float64, float32 and int64; results go into arrays that the caller brings.
"""

try:
    from sim_backend.fem.kernel._kernel import (
        Fronts,
        block_product,
        cell_forces,
        cell_tangents,
        extend_front,
        front_down,
        front_up,
        join_blocks,
        least_area_ratio,
        unit_pressure,
        wedge_tangents,
    )
except ImportError:  # there was no compiler where palpate was installed
    BUILT = False
else:
    BUILT = True

__all__ = [
    "BUILT", "Fronts", "block_product", "cell_forces", "cell_tangents", "extend_front",
    "front_down", "front_up", "join_blocks", "least_area_ratio", "unit_pressure", "wedge_tangents",
]  # fmt: skip
