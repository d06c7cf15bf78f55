"""Products of Chebyshev polynomials up to a total degree."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev

from sim_backend.arrays import Array, Ints


class Basis:
    """Products of Chebyshev polynomials of some coordinates, up to a total ``degree`` to which each
    coordinate's own counts by its ``weights`` (dimensions,); of those, the ones that stay as they
    are where the first ``odd`` coordinates change sign together.

    Coordinates are meant to lie within -1 and 1.
    """

    def __init__(self, degree: int, weights: Sequence[float], odd: int = 0) -> None:
        self.degree, self.weights, self.odd = degree, weights, odd

    @cached_property
    def exponents(self) -> Ints:
        """The degree (terms, dimensions) of each factor of each product."""
        found: list[tuple[int, ...]] = [()]
        for weight in self.weights:
            found = [
                (*head, k) for head in found for k in range(self.degree + 1)
                if np.dot(head, self.weights[: len(head)]) + k * weight <= self.degree
            ]  # fmt: skip
        products = np.array(found)
        return np.asarray(products[products[:, : self.odd].sum(axis=1) % 2 == 0])

    def values(self, coordinates: Array) -> Array:
        """The products (n, terms) at ``coordinates`` (n, dimensions)."""
        return self.products(coordinates, self.exponents)

    def products(self, coordinates: Array, exponents: Ints) -> Array:
        """Those (n, terms) of ``exponents`` (terms, dimensions)."""
        factors = chebyshev.chebvander(coordinates, self.degree).T
        result = np.ones((len(exponents), len(coordinates)))
        for factor, exponent in zip(factors.swapaxes(0, 1), exponents.T, strict=True):
            there = np.flatnonzero(exponent)
            result[there] *= factor[exponent[there]]
        return result.T
