"""A bonded finger: what has touched it keeps its place on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backend.fem.assembly import gather

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def grip_on(surface: Ints, at_m: Array | None, firm: float) -> "Grip":
    """The grip that holds nothing where ``at_m`` is None."""
    return Grip(surface, np.full(len(surface), np.nan) if at_m is None else at_m, firm)


@dataclass(frozen=True)
class Grip:
    """Springs of stiffness ``firm`` [N/m²] that hold ``surface`` nodes (s,) sideways at ``at_m``
    (s,), NaN where free. The finger moves up and down only, so that what it holds does too.
    """

    surface: Ints
    at_m: Array
    firm: float

    @property
    def stuck(self) -> NDArray[np.bool_]:
        """Which nodes (s,) are held."""
        return np.isfinite(self.at_m)

    @property
    def blocks(self) -> Array:
        """Tangent (s, 2, 2)."""
        along = np.array([[1.0, 0.0], [0.0, 0.0]])
        return np.asarray(np.where(self.stuck, self.firm, 0.0)[:, None, None] * along)

    def force(self, u: Array, size: int) -> Array:
        """Residual (size,) at displacements ``u`` (n, 2) [m]."""
        slip = np.where(self.stuck, u[self.surface, 0] - self.at_m, 0.0)
        return gather(size, 2 * self.surface[:, None], self.firm * slip[:, None])

    def now_holding(self, touched: NDArray[np.bool_], u: Array) -> Array:
        """``at_m`` with what has been ``touched`` (s,) since."""
        return np.where(touched & ~self.stuck, u[self.surface, 0], self.at_m)
