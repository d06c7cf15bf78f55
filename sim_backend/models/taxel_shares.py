"""What each taxel of an array takes of a station's force, over depth and lumen pressure.

Shares run straight over the root of the depth, with which a round finger's contact widens (Hertz;
Johnson 1985, eq. 4.22), and straight over the pressure. So taxels that share all of the force
where they are solved share all of it everywhere.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sim_backend.arrays import Array, Ints


@dataclass(frozen=True)
class TaxelShares:
    """Shares ``rest`` (d, rows, columns) at the resting pressure, increasingly ``sunk`` (d,) [m],
    and what they change by for each pascal more (d, rows, columns); beyond either end of ``sunk``
    as at that end."""

    sunk: Array
    rest: Array
    by_pressure: Array

    def __call__(self, sunk: Array, over_pa: Array) -> Array:
        """Shares (n, rows, columns) ``sunk`` (n,) [m], at pressures ``over_pa`` rest (n,) [Pa]."""
        below, weight = _weights(self.sunk, sunk)
        return _between(self.rest, below, weight) + over_pa[:, None, None] * _between(
            self.by_pressure, below, weight
        )

    def seen_from(self, *, across: bool, along: bool) -> Self:
        """The mirror image across the vessels, along them, both or neither."""
        turn = np.s_[:, :: -1 if along else 1, :: -1 if across else 1]
        return replace(self, rest=self.rest[turn], by_pressure=self.by_pressure[turn])


def at_depths(known: Array, values: Array, sunk: Array) -> Array:
    """``values`` (k, rows, columns) at depths ``known`` (k,) as they are at those ``sunk`` (n,)."""
    return _between(values, *_weights(known, sunk))


def _weights(known: Array, sunk: Array) -> tuple[Ints, Array]:
    """Number (n,) of the depth above, and how far (n,) each is from there to the next."""
    place = np.interp(np.sqrt(np.maximum(sunk, 0.0)), np.sqrt(known), np.arange(len(known)))
    below = np.minimum(place.astype(np.int64), max(len(known) - 2, 0))
    return below, place - below


def _between(values: Array, below: Ints, weight: Array) -> Array:
    upper, share = values[np.minimum(below + 1, len(values) - 1)], weight[:, None, None]
    return np.asarray((1 - share) * values[below] + share * upper)
