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
from numpy.polynomial import chebyshev

from sim_backend.arrays import Array, Ints
from sim_backend.touch.basis import Basis
from sim_backend.touch.kinds import BARE, KINDS, OF_ROW, Kind, aside


@dataclass(frozen=True)
class Ratios:
    """Of one kind: polynomials of ``coefficients`` (terms, 2), bump and pulse over the force of the
    bare block and over `Kind.size`, of coordinates between ``low`` and ``high`` (c,).

    ``error`` (2, 2): what they are off by in states that they were not trained on, a part over
    `Kind.size` there and a part over that right over the body, and of each bump and pulse.
    """

    kind: Kind
    low: Array
    high: Array
    coefficients: Array
    error: Array

    @cached_property
    def basis(self) -> Basis:
        return Basis(self.kind.degree, self.kind.weights, self.kind.mirrored)

    def scaled(self, coordinates: Array) -> Array:
        """Coordinates between -1 and 1; beyond its ends a polynomial is worth nothing."""
        return np.clip(2 * (coordinates - self.low) / (self.high - self.low) - 1, -1.1, 1.1)

    def scaled_across(self, across: Array) -> Array:
        """The first coordinate (n,) between -1 and 1."""
        return np.asarray(across / self.high[0])

    def __call__(self, x: Array, sunk: Array, theta: Array) -> Array:
        """Bump and pulse (n, 2) over the bare block's force."""
        coordinates = self.scaled(self.kind.at(x, sunk, theta))
        return self.kind.size(x, theta) * (self.basis.values(coordinates) @ self.coefficients)

    def off_by(self, x: Array, theta: Array) -> Array:
        """What bump and pulse (n, 2) may be off by at places (n,), over the bare block's force: a
        standard deviation."""
        there, over = self.kind.size(x, theta), self.kind.central(theta)
        return np.asarray(np.hypot(there * self.error[0], over * self.error[1]))

    def at_depths(self, sunk: Array, block: Array) -> "AtDepths":
        """The same at some depths (d,) over one ``block`` (2,), for many bodies and places: what is
        of block and depth alone, the last coordinates, is summed over once."""
        some_body = np.mean([self.kind.low, self.kind.high], axis=0)[: -len(block)]
        here = np.tile(np.concatenate([some_body, block]), (len(sunk), 1))
        of_row = self.scaled(self.kind.at(here[:, 0], sunk, here))[:, -OF_ROW:]
        exponents = self.basis.exponents
        along = self.basis.products(of_row, exponents[:, -OF_ROW:])
        of_body, row = np.unique(exponents[:, 1:-OF_ROW], axis=0, return_inverse=True)
        summed = np.zeros((len(of_body), self.basis.degree + 1, len(sunk), 2))
        weighted = along.T[:, :, None] * self.coefficients[:, None, :]
        np.add.at(summed, (row.ravel(), exponents[:, 0]), weighted)
        return AtDepths(self, sunk, of_body, summed)


@dataclass(frozen=True)
class AtDepths:
    """`Ratios` at depths (d,): ``summed`` (terms, degree + 1, d, 2) of products of the body's own
    coordinates with ``exponents`` (terms, c - 1 - `OF_ROW`), and of powers of the first one, the
    place's."""

    ratios: Ratios
    sunk: Array
    exponents: Ints
    summed: Array

    def __call__(self, x: Array, theta: Array) -> Array:
        """Bump and pulse (m, n, d, 2) at places ``x`` (n,), or (m, n) of each body's own, over
        bodies ``theta`` (m, p)."""
        kind, ratios, count = self.ratios.kind, self.ratios, x.shape[-1]
        scaled = ratios.scaled(kind.at(theta[:, 0], np.ones(len(theta)), theta))
        terms = ratios.basis.products(scaled[:, 1:-OF_ROW], self.exponents)
        of_body = np.tensordot(terms, self.summed, axes=1)
        places = np.broadcast_to(x, (len(theta), count)).ravel()
        bodies = np.repeat(theta, count, axis=0)
        across = ratios.scaled_across(aside(places, bodies)[0])
        powers = chebyshev.chebvander(across, ratios.basis.degree).reshape(len(theta), count, -1)
        found = powers @ of_body.reshape(len(theta), powers.shape[2], -1)
        size = kind.size(places, bodies).reshape(len(theta), count, 1, 2)
        return np.asarray(found.reshape(len(theta), count, -1, 2) * size)


@dataclass(frozen=True)
class TouchTable:
    """Of one shape of finger over blocks of any size, lengths over the finger's half width."""

    about: Mapping[str, Any]
    ratios: Mapping[str, Ratios]

    def said(self) -> dict[str, Any]:
        """What it is of, in words too, and its `Ratios.error` of each kind."""
        about = self.about
        support = "a bonded support" if about["bonded"] else "a sliding support"
        held = {kind.name: self.ratios[kind.name].error.tolist() for kind in (BARE, *KINDS)}
        words = f"{about['shape']} on {support}, plane {about['plane']}"
        return {**about, "errors": held, "words": words}

    @property
    def depths(self) -> tuple[float, float]:
        """The least and the greatest that was trained on."""
        bare = self.ratios[BARE.name]
        return float(np.exp(bare.low[-1])), float(np.exp(bare.high[-1]))

    def knows(self, scene: Any) -> bool:
        """Whether a scene's block is one of those that the table was trained on."""
        block = block_of(scene)
        return bool(((block >= BARE.low) & (block <= BARE.high)).all())

    def bare_force(self, x: Array, sunk: Array, block: Array) -> Array:
        """Force (n,) of a bare ``block`` (2,) over modulus, half width and length."""
        theta = np.tile(block, (len(x), 1))
        return np.asarray(sunk * np.exp(self.ratios[BARE.name](x, sunk, theta)[:, 0]))

    def save(self, path: Path) -> None:
        """As one file of numpy's."""
        flat = {
            f"{name}.{key}": getattr(ratios, key)
            for name, ratios in self.ratios.items()
            for key in ("low", "high", "coefficients", "error")
        }
        about = {f"about.{key}": np.array(value) for key, value in self.about.items()}
        np.savez_compressed(path, allow_pickle=False, **flat, **about)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Raises `OSError`, `KeyError` and `ValueError` for a file that is none, or that another
        version made."""
        with np.load(path) as file:
            ratios = {
                kind.name: Ratios(
                    kind, file[f"{kind.name}.low"], file[f"{kind.name}.high"],
                    file[f"{kind.name}.coefficients"], file[f"{kind.name}.error"],
                )
                for kind in (BARE, *KINDS)
            }  # fmt: skip
            if any(len(r.coefficients) != len(r.basis.exponents) for r in ratios.values()):
                raise ValueError(f"{path}: its polynomials are another version's")
            about = {
                key.removeprefix("about."): file[key].item()
                for key in file.files
                if key.startswith("about.")
            }
            return cls(about, ratios)


def about_finger(scene: Any) -> dict[str, Any]:
    """What a table depends on: the finger's shape over its half width, and how it meets a block."""
    finger = scene.indenter
    half_mm = finger.width_mm_projected / 2
    edge_mm = getattr(finger, "edge_radius_mm", None) or half_mm
    return {
        "shape": finger.shape, "edge": edge_mm / half_mm, "plane": scene.plane,
        "poisson": scene.tissue.poisson, "bonded": scene.bonded_support, "sticks": finger.bonded,
    }  # fmt: skip


def block_of(scene: Any) -> Array:
    """The block (2,) of a scene, as `sim_backend.touch.kinds.BLOCK` has it."""
    half_mm = scene.indenter.width_mm_projected / 2
    return np.log([scene.tissue.height_mm / half_mm, scene.tissue.width_mm / 2 / half_mm])
