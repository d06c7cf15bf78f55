"""What `module.c` gives to Python."""

from sim_backend.arrays import Array, Ints, Singles

def cell_forces(
    u: Array, nodes: Ints, gradient: Array, weight: Array, shear: Array, bulk: Array, law: int,
    force: Array, thickness: Array, /,
) -> None: ...  # fmt: skip
def cell_tangents(
    u: Array, nodes: Ints, gradient: Array, weight: Array, shear: Array, bulk: Array, law: int,
    thickness: Array, tangent: Array, change: Array | None, /,
) -> None: ...  # fmt: skip
def least_area_ratio(
    u: Array, nodes: Ints, gradient: Array, weight: Array, shear: Array, bulk: Array, law: int, /
) -> float: ...
def unit_pressure(
    u: Array, nodes: Ints, place: Array, spread: Array, along: Array, gradient: Array,
    shear: Array, bulk: Array, free: bool, force: Array, tangent: Array, /,
) -> None: ...  # fmt: skip
def wedge_tangents(
    gradient: Array, f: Array, h: Array, slopes: Array, tangents: Singles, /
) -> None: ...
def join_blocks(blocks: Singles, place: Ints, sums: Singles, /) -> None: ...
def block_product(
    blocks: Singles, columns: Ints, starts: Ints, x: Singles, y: Singles, /
) -> None: ...
def extend_front(update: Singles, at: Ints, top: Singles, rest: Singles, /) -> None: ...
def front_down(
    root: Singles, coupled: Singles, border: Ints, own: Singles, x: Singles, /
) -> None: ...
def front_up(
    root: Singles, coupled: Singles, border: Ints, own: Singles, x: Singles, /
) -> None: ...

class Fronts:
    """A `sim_backend.fem.assembly.Solver` of ``groups`` of element matrices, of which the
    ``symmetric`` ones are so; all but the ``free`` displacements of ``size`` are fixed."""

    def __new__(
        cls, size: int, groups: tuple[Ints, ...], symmetric: tuple[bool, ...], free: Ints, /
    ) -> Fronts: ...
    def factor(self, matrices: tuple[Array, ...], /) -> int: ...
    def solve(self, force: Array, x: Array, /) -> None: ...
