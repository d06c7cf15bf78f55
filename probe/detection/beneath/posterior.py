"""What is known of a model's parameters: the modes of its posterior, then importance sampling.

Parameters lie in a box in which the prior is even; their logits have no ends. Least squares from
several starts finds modes; a mixture of Student's t distributions about them proposes points, and
is fitted to the points that weigh most, a few times (adaptive multiple importance sampling, Cornuet
et al. 2012). The mean weight is the evidence.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import expit, gammaln, log_expit, logit, logsumexp

from drivers.core.arrays import Array, Bools

ROUNDS, POINTS = 8, 2000
FREEDOM = 5.0
"""Degrees of freedom of the proposals, whose tails must be heavier than the posterior's."""
MODES = 3
STEP = 1e-5
SAME_FIT = 3
"""Decimals of a chi-square to which modes are one: a parameter that means nothing, as a plaque's
modulus where there is no narrowing, is anywhere in them."""
FEWEST = 8
"""Effective points a parameter that a proposal is fitted to, by flattening the weights."""


@dataclass(frozen=True)
class Model:
    """A posterior in the box ``low`` to ``high`` (p,): ``misfit`` of points (m, p) are whitened
    residuals (m, n), ``allowed`` (m,) says where there is any prior at all, ``log_norm`` is the log
    of the likelihood's norm, ``starts`` (s, p) is where modes are looked for."""

    low: Array
    high: Array
    misfit: Callable[[Array], Array]
    allowed: Callable[[Array], Bools]
    log_norm: float
    starts: Array

    def at(self, logits: Array) -> Array:
        """Points (m, p) by their places (m, p) in the box, as logits."""
        return np.asarray(self.low + expit(logits) * (self.high - self.low))


@dataclass(frozen=True)
class Posterior:
    """``points`` (m, p) with ``weights`` (m,) that sum to one, the most likely one ``best`` (p,),
    its ``chi2``, and the log of the evidence. ``effective``: as many independent points."""

    points: Array
    weights: Array
    best: Array
    chi2: float
    log_evidence: float
    effective: float

    def quantiles(self, values: Array, shares: tuple[float, ...] = (0.025, 0.5, 0.975)) -> Array:
        """Of a function's ``values`` (m,) at the points."""
        order = np.argsort(values)
        below = np.cumsum(self.weights[order])
        at = np.minimum(np.searchsorted(below, shares), len(values) - 1)
        return np.asarray(values[order][at])


def sample(model: Model, rng: np.random.Generator) -> Posterior:
    """The posterior of a model."""
    modes = _modes(model)
    mixture: list[Component] = [(m, np.asarray(1.5 * np.linalg.inv(c))) for _, m, c in modes]
    proposals: list[list[Component]] = []
    drawn: list[Array] = []
    heights: list[Array] = []
    for _ in range(ROUNDS):
        proposals.append(mixture)
        drawn.append(_drawn(mixture, rng))
        heights.append(_log_posterior(model, drawn[-1]))
        log_weight = heights[-1] - _log_density(drawn[-1], mixture)
        if np.isfinite(log_weight).any():
            mixture = _fitted(drawn[-1], log_weight)
    logits = np.concatenate(drawn)
    # each point is weighed by all proposals, so that none that missed a part has it weigh too much
    each = [_log_density(logits, proposal) for proposal in proposals]
    log_weight = np.concatenate(heights) - logsumexp(each, axis=0) + np.log(ROUNDS)
    possible, count = np.isfinite(log_weight), len(logits)
    total = float(logsumexp(log_weight))
    points = model.at(logits[possible])
    weights = np.exp(log_weight[possible] - total)
    chi2, best, _ = modes[0]
    # none is possible where all that fits well has no room
    effective = 1 / float((weights**2).sum()) if len(weights) else 0.0
    return Posterior(
        points, weights, model.at(best[None])[0], chi2, total - np.log(count), effective
    )


class Fit(NamedTuple):
    """The point (p,) of least misfit, and the log of the evidence as of Gaussians about all
    modes."""

    best: Array
    log_evidence: float


def laplace(model: Model) -> Fit:
    """The posterior as Gaussians about its modes (Laplace's approximation)."""
    modes = _modes(model)
    heights = [
        model.log_norm - 0.5 * chi2 + _log_prior(mode[None])[0]
        - 0.5 * np.linalg.slogdet(curvature / (2 * np.pi))[1]
        for chi2, mode, curvature in modes
    ]  # fmt: skip
    return Fit(model.at(modes[0][1][None])[0], float(logsumexp(heights)))


Component = tuple[Array, Array]
"""Middle (p,) and covariance (p, p) of a proposal, in logits."""


def _modes(model: Model) -> list[tuple[float, Array, Array]]:
    """Chi-squares, places and curvatures of the least misfits, the best first."""
    span = model.high - model.low

    def misfit(unit: Array) -> Array:
        return np.asarray(model.misfit((model.low + unit * span)[None])[0])

    def slopes(unit: Array) -> Array:
        """All steps at once."""
        steps = np.where(unit > 0.5, -STEP, STEP)
        moved = model.misfit(model.low + np.vstack([unit, unit + np.diag(steps)]) * span)
        return np.asarray((moved[1:] - moved[0]) / steps[:, None]).T

    found = []
    for start in model.starts:
        begin = np.clip((start - model.low) / span, 0.02, 0.98)
        solved = least_squares(misfit, begin, slopes, bounds=(0, 1), x_scale=0.2, max_nfev=25)
        unit = np.clip(solved.x, 0.01, 0.99)
        slope = unit * (1 - unit)
        along = np.asarray(solved.jac) * slope
        curvature = along.T @ along
        found.append((2 * solved.cost, logit(unit), curvature + np.diag(2 * slope)))
    found.sort(key=lambda mode: round(mode[0], SAME_FIT))  # of equal ones the first, not rounding's
    apart = [found[0]]
    for one in found[1:]:
        near = any(np.abs(expit(one[1]) - expit(m[1])).max() < 0.1 for m in apart)
        if one[0] < found[0][0] + 12 and not near:
            apart.append(one)
    return apart[:MODES]


def _drawn(mixture: list[Component], rng: np.random.Generator) -> Array:
    which = rng.integers(len(mixture), size=POINTS)
    scale = np.sqrt(rng.chisquare(FREEDOM, POINTS) / FREEDOM)
    steps = rng.normal(size=(POINTS, len(mixture[0][0]))) / scale[:, None]
    points = np.empty_like(steps)
    for k, (middle, spread) in enumerate(mixture):
        mine = which == k
        points[mine] = middle + steps[mine] @ np.linalg.cholesky(spread).T
    return points


def _log_density(logits: Array, mixture: list[Component]) -> Array:
    """Of the mixture of multivariate t distributions (m,), all components alike."""
    size = logits.shape[1]
    each = []
    for middle, spread in mixture:
        root = np.linalg.cholesky(spread)
        away = np.linalg.solve(root, (logits - middle).T)
        each.append(
            gammaln((FREEDOM + size) / 2) - gammaln(FREEDOM / 2)
            - size / 2 * np.log(FREEDOM * np.pi) - np.log(np.diag(root)).sum()
            - (FREEDOM + size) / 2 * np.log1p((away**2).sum(axis=0) / FREEDOM)
        )  # fmt: skip
    return np.asarray(logsumexp(each, axis=0) - np.log(len(mixture)))


def _log_prior(logits: Array) -> Array:
    """Of logits (m, p) of a point that is anywhere in the box."""
    return np.asarray((log_expit(logits) + log_expit(-logits)).sum(axis=1))


def _log_posterior(model: Model, logits: Array) -> Array:
    """Log likelihood and prior (m,) of logits; minus infinity where nothing can be."""
    prior = _log_prior(logits)
    points = model.at(logits)
    found = np.where(model.allowed(points), prior, -np.inf)
    can_be = np.isfinite(found)
    if can_be.any():
        misfit = model.misfit(points[can_be])
        found[can_be] += model.log_norm - 0.5 * (misfit**2).sum(axis=1)
    return found


def _fitted(logits: Array, log_weight: Array) -> list[Component]:
    """Proposals by mean and covariance of the points that weigh most, and of their two halves along
    their longest axis."""
    power, size = 1.0, logits.shape[1]
    while True:
        weights = np.exp(power * (log_weight - log_weight.max()))
        weights /= weights.sum()
        if 1 / (weights**2).sum() >= FEWEST * size or power < 1e-4:
            break
        power *= 0.7
    middle, spread = _moments(logits, weights)
    along = np.linalg.eigh(spread)[1][:, -1]
    mixture = [(middle, 1.2 * spread)]
    for side in (1, -1):
        half = weights * (side * ((logits - middle) @ along) > 0)
        if half.sum() > 0.1:
            half_middle, half_spread = _moments(logits, half / half.sum())
            mixture.append((half_middle, 1.3 * half_spread))
    return mixture


def _moments(logits: Array, weights: Array) -> Component:
    middle = weights @ logits
    away = logits - middle
    return middle, away.T @ (weights[:, None] * away) + 1e-4 * np.eye(len(middle))
