"""What a finger meets over a block with something in it, in microseconds: polynomials that were
trained on presses of the finite elements and on their exact derivatives.

Only numpy is imported here. `sim_backend.models.train_touch` makes tables.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.touch.basis import Basis
from sim_backend.touch.kinds import KINDS, Kind


@dataclass(frozen=True)
class Ratios:
    """Of one kind: polynomials of ``coefficients`` (terms, 2), bump and pulse over the force of the
    bare block and over `Kind.size`, of coordinates between ``low`` and ``high`` (c,).

    ``error`` (2,): root mean square of what they are off by over `Kind.central`, in states that
    they were not trained on.
    """

    kind: Kind
    low: Array
    high: Array
    coefficients: Array
    error: Array

    @cached_property
    def basis(self) -> Basis:
        return Basis(len(self.low), self.kind.degree)

    def scaled(self, coordinates: Array) -> Array:
        """Coordinates between -1 and 1; beyond its ends a polynomial is worth nothing."""
        return np.clip(2 * (coordinates - self.low) / (self.high - self.low) - 1, -1.1, 1.1)

    def __call__(self, x: Array, sunk: Array, theta: Array) -> Array:
        """Bump and pulse (n, 2) over the bare block's force."""
        coordinates = self.scaled(self.kind.coordinates(x, sunk, theta))
        return self.kind.size(x, theta) * (self.basis.values(coordinates) @ self.coefficients)

    def off_by(self, theta: Array) -> Array:
        """What bump and pulse (n, 2) may be off by, over the bare block's force."""
        return self.kind.central(theta) * self.error

    def at_depths(self, sunk: Array) -> "AtDepths":
        """The same at some depths (d,), for many bodies and places: what is of the depth alone, the
        last coordinate, is summed over once."""
        last = np.zeros((len(sunk), len(self.low)))
        last[:, -1] = sunk
        along = np.polynomial.chebyshev.chebvander(self.scaled(last)[:, -1], self.basis.degree)
        exponents = self.basis.exponents
        of_body, row = np.unique(exponents[:, 1:-1], axis=0, return_inverse=True)
        summed = np.zeros((len(of_body), self.basis.degree + 1, len(sunk), 2))
        weighted = along.T[exponents[:, -1], :, None] * self.coefficients[:, None, :]
        np.add.at(summed, (row.ravel(), exponents[:, 0]), weighted)
        return AtDepths(self, sunk, of_body, summed)


@dataclass(frozen=True)
class AtDepths:
    """`Ratios` at depths (d,): ``summed`` (terms, degree + 1, d, 2) of products of the body's own
    coordinates with ``exponents`` (terms, c - 2), and of powers of the first one, the place's."""

    ratios: Ratios
    sunk: Array
    exponents: Ints
    summed: Array

    def __call__(self, x: Array, theta: Array) -> Array:
        """Bump and pulse (m, n, d, 2) at places ``x`` (n,) over bodies ``theta`` (m, p)."""
        kind, ratios, count = self.ratios.kind, self.ratios, len(x)
        here = ratios.scaled(kind.coordinates(theta[:, 0], np.zeros(len(theta)), theta))[:, 1:-1]
        terms = ratios.basis.products(here, self.exponents)
        of_body = np.tensordot(terms, self.summed, axes=1)
        places, bodies = np.tile(x, len(theta)), np.repeat(theta, count, axis=0)
        aside = kind.coordinates(places, np.zeros(len(places)), bodies)[:, :1]
        scaled = np.clip(
            2 * (aside[:, 0] - ratios.low[0]) / (ratios.high[0] - ratios.low[0]) - 1, -1.1, 1.1
        )
        powers = np.polynomial.chebyshev.chebvander(scaled, ratios.basis.degree)
        powers = powers.reshape(len(theta), count, -1)
        found = np.einsum("mnk,mkde->mnde", powers, of_body, optimize=True)
        return np.asarray(found * kind.size(places, bodies).reshape(len(theta), count, 1, 2))


@dataclass(frozen=True)
class TouchTable:
    """Of one shape of finger over a block of one height, all over the finger's half width.

    ``bare`` (d, m) is the bare block's force at the depths ``sunk`` (d,) and the places ``middle``
    (m,) from the block's middle on, over modulus, half width and length; the block is even.
    """

    about: Mapping[str, Any]
    sunk: Array
    middle: Array
    bare: Array
    ratios: Mapping[str, Ratios]

    def bare_force(self, x: Array, sunk: Array) -> Array:
        """Force (n,) of the bare block, by cubics through its solved states."""
        there = np.array([_cubic(self.middle, row, np.abs(x)) for row in self.bare])
        powers = _lagrange(np.append(0.0, self.sunk), sunk)[:, 1:]
        return np.asarray((powers * there.T).sum(axis=1))

    def save(self, path: Path) -> None:
        """As one file of numpy's."""
        flat = {
            f"{name}.{key}": getattr(one, key)
            for name, one in self.ratios.items()
            for key in ("low", "high", "coefficients", "error")
        }
        about = {f"about.{key}": np.array(value) for key, value in self.about.items()}
        own = {"sunk": self.sunk, "middle": self.middle, "bare": self.bare}
        np.savez_compressed(path, allow_pickle=False, **own, **flat, **about)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Raises `OSError` and `ValueError` for a file that is none."""
        with np.load(path) as file:
            ratios = {
                kind.name: Ratios(
                    kind, file[f"{kind.name}.low"], file[f"{kind.name}.high"],
                    file[f"{kind.name}.coefficients"], file[f"{kind.name}.error"],
                )
                for kind in KINDS
                if f"{kind.name}.low" in file
            }  # fmt: skip
            about = {
                key.removeprefix("about."): file[key].item()
                for key in file.files
                if key.startswith("about.")
            }
            return cls(about, file["sunk"], file["middle"], file["bare"], ratios)


def about_block(block: Any) -> dict[str, Any]:
    """What a table depends on: the shapes of finger and block, over the finger's half width."""
    finger, tissue = block.indenter, block.tissue
    half_mm = finger.width_mm_projected / 2
    edge_mm = getattr(finger, "edge_radius_mm", None) or half_mm
    return {
        "shape": finger.shape, "edge": edge_mm / half_mm, "plane": block.plane,
        "width": tissue.width_mm / half_mm, "height": tissue.height_mm / half_mm,
        "poisson": tissue.poisson, "bonded": block.bonded_support, "sticks": finger.bonded,
    }  # fmt: skip


def _lagrange(nodes: Array, at: Array) -> Array:
    """Weights (n, nodes) of the values at ``nodes`` of the polynomial through them all."""
    weights = np.ones((len(at), len(nodes)))
    for i, node in enumerate(nodes):
        for other in np.delete(nodes, i):
            weights[:, i] *= (at - other) / (node - other)
    return weights


def _cubic(nodes: Array, values: Array, at: Array) -> Array:
    """Cubics (n,) through values and central slopes; level at the first node, where all is even."""
    slope = np.gradient(values, nodes)
    slope[0] = 0.0
    i = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
    width = nodes[i + 1] - nodes[i]
    t = np.clip((at - nodes[i]) / width, 0.0, 1.0)
    return np.asarray(
        (2 * t**3 - 3 * t**2 + 1) * values[i] + (t**3 - 2 * t**2 + t) * width * slope[i]
        + (3 * t**2 - 2 * t**3) * values[i + 1] + (t**3 - t**2) * width * slope[i + 1]
    )  # fmt: skip
