"""A vessel that is open under one row and narrowed under another.

One row cannot tell a narrowing from a stiff wall. Two rows of one vessel can: tissue, pressures,
lumen and wall are the same in both, so that what differs is the narrowing.
"""

from dataclasses import dataclass

import numpy as np

from drivers.core.arrays import Array, Bools
from probe.detection.beneath.hypotheses import Bodies, Likelihood
from probe.detection.beneath.posterior import Model, laplace
from sim_backend.touch.kinds import VESSEL

ALONE = Bodies((VESSEL,))
NARROWING, OWN = "0.narrowing", ("0.x", "0.depth")
"""What an open vessel has none of, and what is each row's own; all else both have in common."""
NAMES = (*ALONE.names, *(f"open {name}" for name in OWN))
"""Parameters of a point: those of the narrowed row, then the open row's own."""
OF_OPEN = [
    NAMES.index(f"open {name}") if name in OWN else NAMES.index(name) for name in ALONE.names
]
FIRST = (0.15, 0.35, 0.55)
"""Narrowings from which the fit starts: the range in thirds."""


def narrowed(theta: Array) -> Array:
    """Parameters (m, p) of the narrowed row's vessel, at points (m, p + 2)."""
    return theta[:, : len(ALONE.names)]


def opened(theta: Array) -> Array:
    """Those of the open row's."""
    vessel = theta[:, OF_OPEN]
    vessel[:, ALONE.names.index(NARROWING)] = 0.0
    return vessel


@dataclass(frozen=True)
class TwoRows:
    """The likelihoods of a row over the narrowing, and of one over the open vessel."""

    narrowed_row: Likelihood
    open_row: Likelihood

    @property
    def count(self) -> int:
        """Numbers that were measured in both."""
        return len(self.narrowed_row.measured) + len(self.open_row.measured)

    def model(self) -> Model | None:
        """Of both rows together, with the errors that the table has about each one's own fit; None
        where one has no room for a vessel. These errors are alike in both rows: with twice their
        variance the mean is known no better."""
        rows = self.narrowed_row, self.open_row
        firsts = [row.model(ALONE) for row in rows]
        if not all(len(first.starts) for first in firsts):
            return None
        fits = [laplace(first).best for first in firsts]
        of_narrowed, of_open = (
            row.model(ALONE, fit, len(rows) * row.table_error(ALONE, fit))
            for row, fit in zip(rows, fits, strict=True)
        )

        def misfit(theta: Array) -> Array:
            return np.hstack([of_narrowed.misfit(narrowed(theta)), of_open.misfit(opened(theta))])

        def allowed(theta: Array) -> Bools:
            return of_narrowed.allowed(narrowed(theta)) & of_open.allowed(opened(theta))

        own = [ALONE.names.index(name) for name in OWN]
        starts = np.tile(np.append(fits[1], fits[1][own]), (len(FIRST), 1))
        starts[:, own] = fits[0][own]
        starts[:, NAMES.index(NARROWING)] = FIRST
        low, high = (
            np.append(a, b[own])
            for a, b in ((of_narrowed.low, of_open.low), (of_narrowed.high, of_open.high))
        )
        return Model(low, high, misfit, allowed, of_narrowed.log_norm + of_open.log_norm, starts)
