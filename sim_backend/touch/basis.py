"""Products of Chebyshev polynomials up to a total degree, and their derivatives."""

from functools import cached_property
from itertools import product

import numpy as np
from numpy.polynomial import chebyshev

from sim_backend.arrays import Array, Ints


class Basis:
    """All products of Chebyshev polynomials of ``dimensions`` coordinates up to a total degree.

    Coordinates are meant to lie within -1 and 1.
    """

    def __init__(self, dimensions: int, degree: int) -> None:
        self.dimensions, self.degree = dimensions, degree

    @cached_property
    def exponents(self) -> Ints:
        """The degree (terms, dimensions) of each factor of each product."""
        found: list[tuple[int, ...]] = [()]
        for _ in range(self.dimensions):
            found = [
                (*head, k) for head, k in product(found, range(self.degree + 1))
                if sum(head) + k <= self.degree
            ]  # fmt: skip
        return np.array(found)

    def values(self, coordinates: Array) -> Array:
        """The products (n, terms) at ``coordinates`` (n, dimensions)."""
        return self.products(coordinates, self.exponents)

    def products(self, coordinates: Array, exponents: Ints) -> Array:
        """Those (n, terms) of ``exponents`` (terms, dimensions)."""
        return _products(self._factors(coordinates), exponents)

    def derivatives(self, coordinates: Array) -> Array:
        """Their derivatives (dimensions, n, terms) by each coordinate."""
        factors = self._factors(coordinates)
        slopes = factors @ _differentiation(self.degree)
        found = []
        for k in range(self.dimensions):
            one_slope = factors.copy()
            one_slope[k] = slopes[k]
            found.append(_products(one_slope, self.exponents))
        return np.array(found)

    def _factors(self, coordinates: Array) -> Array:
        return np.array([chebyshev.chebvander(z, self.degree) for z in coordinates.T])


def _products(factors: Array, exponents: Ints) -> Array:
    """Products (n, terms) of ``factors`` (dimensions, n, degree + 1)."""
    result = np.ones((factors.shape[1], len(exponents)))
    for factor, exponent in zip(factors, exponents.T, strict=True):
        if exponent.any():
            result *= factor[:, exponent]
    return result


def _differentiation(degree: int) -> Array:
    """T_k' in terms of T_0 to T_degree, a column each."""
    matrix = np.zeros((degree + 1, degree + 1))
    for k in range(1, degree + 1):
        slope = chebyshev.chebder(np.eye(k + 1)[k])
        matrix[: len(slope), k] = slope
    return matrix
