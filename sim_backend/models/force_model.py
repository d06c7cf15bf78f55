"""What every model of a press answers: the force at a place, a depth and a lumen pressure.

| model | knows | one answer takes |
|---|---|---|
| `station_response.StationResponse` | one place, all depths and pressures | microseconds |
| `fast.FastModel` | a box of places, depths and pressures | microseconds |

Who needs a force takes a `ForceModel` and need not know which it is.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array, Bools

SLACK = 1e-8
"""What a place or depth [m] may lie outside a range, and a pressure over the range's end: the
rounding of a path."""


class ForceSlope(NamedTuple):
    """How the force changes with depth [N/m] and with lumen pressure [N/Pa]."""

    by_depth_n_m: Array
    by_pressure_n_pa: Array


class OutOfRange(ValueError):
    """A place, depth or pressure that a model does not know; says which it does."""


@dataclass(frozen=True)
class Range:
    """(low, high) of the places [m], depths [m] and lumen pressures [Pa] that a model knows."""

    x_m: tuple[float, float]
    depth_m: tuple[float, float]
    pressure_pa: tuple[float, float]

    def holds(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Bools:
        """Which are known; what is not a number is not."""
        slack_pa = SLACK * abs(self.pressure_pa[1])
        return np.asarray(
            _within(x_m, self.x_m, SLACK)
            & _within(depth_m, self.depth_m, SLACK)
            & _within(pressure_pa, self.pressure_pa, slack_pa)
        )

    def check(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> None:
        """Raises `OutOfRange` unless all are known."""
        slack_pa = SLACK * abs(self.pressure_pa[1])
        for what, asked, known, slack, scale, unit in (
            ("place", x_m, self.x_m, SLACK, 1e3, "mm"),
            ("depth", depth_m, self.depth_m, SLACK, 1e3, "mm"),
            ("lumen pressure", pressure_pa, self.pressure_pa, slack_pa, 1e-3, "kPa"),
        ):
            wrong = ~_within(asked, known, slack)
            if wrong.any():
                value = scale * np.asarray(asked, float)[wrong].flat[0]
                raise OutOfRange(
                    f"a {what} of {value:.4g} {unit} is beyond the {scale * known[0]:.4g} to "
                    f"{scale * known[1]:.4g} {unit} that this model knows"
                )


def _within(asked: ArrayLike, known: tuple[float, float], slack: float) -> Bools:
    values = np.asarray(asked, dtype=float)
    return np.asarray((values >= known[0] - slack) & (values <= known[1] + slack))


class ForceModel(Protocol):
    """A scene's elastic answer. All arguments broadcast; all values are of that shape.

    ``x_m`` is along the surface, ``depth_m`` below it (0 and less: in the air, unless a filled
    vessel bulges there), ``pressure_pa`` in every lumen. All methods raise `OutOfRange` (a
    ValueError) outside ``range`` and `CannotSolve` where the physics has no answer; none returns
    NaN.
    """

    @property
    def range(self) -> Range:
        """What is known."""
        ...

    def force_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Normal force [N] on the whole finger."""
        ...

    def slope(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> ForceSlope:
        """The force's slopes by depth and by pressure."""
        ...

    def error_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """What the force may be off by [N]."""
        ...

    def pulse_error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike
    ) -> Array:
        """What the change of force between two pressures may be off by [N]: less than both forces
        are, for what they have in common drops out."""
        ...
