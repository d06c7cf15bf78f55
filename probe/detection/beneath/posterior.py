"""What is known of a model's parameters: the modes of its posterior, then importance sampling.

Parameters lie in a box in which the prior is even; their logits have no ends. Damped steps from
several starts find modes; a mixture of Student's t distributions about them proposes points, and is
fitted to the points that weigh most, a few times (adaptive multiple importance sampling, Cornuet et
al. 2012). The mean weight is the evidence.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.special import expit, gammaln, log_expit, logit, logsumexp

from drivers.core.arrays import Array, Bools

ROUNDS, POINTS, ENOUGH = 8, 2000, 200.0
"""Of sampling at most, and points of each; it ends with so many effective ones."""
FREEDOM = 5.0
"""Degrees of freedom of the proposals, whose tails must be heavier than the posterior's."""
MODES = 3
"""Modes that are proposed about."""
NEAR, LOWER = 0.1, 6.0
"""Of a range, how near modes are one; and how much lower [nat] one may be that matters."""
STEP, STEPS = 1e-5, 12
"""To take a slope by, and steps to a mode at most: with 10 and with 15 of them 64 rows of random
bodies have as many bodies, in the same places."""
FIRST_DAMPING, CHANGE, LEAST_STEP = 1.0, 5.0, 1e-2
"""Of steps to a mode, over the curvature; its change from step to step (Marquardt 1963 takes 10);
and what steps gain [nat] at least."""
MIN_POINTS = 8
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

    def mean(self, values: Array) -> float:
        """Of a function's ``values`` (m,) at the points."""
        return float(self.weights @ values)

    def quantiles(self, values: Array, shares: tuple[float, ...] = (0.025, 0.5, 0.975)) -> Array:
        """Of a function's ``values`` (m,) at the points."""
        order = np.argsort(values)
        below = np.cumsum(self.weights[order])
        at = np.minimum(np.searchsorted(below, shares), len(values) - 1)
        return np.asarray(values[order][at])


class Mode(NamedTuple):
    """Where the posterior is highest: logits (p,), chi-square, less the log of the posterior, and
    its curvature (p, p)."""

    logits: Array
    chi2: float
    cost: float
    curvature: Array


class Fit(NamedTuple):
    """The most likely point (p,), the log of the evidence as of Gaussians about all ``modes``, and
    those, the highest first."""

    best: Array
    log_evidence: float
    modes: Sequence[Mode]

    def alone(self) -> Posterior:
        """A posterior of the most likely point alone."""
        mode = self.modes[0]
        return Posterior(self.best[None], np.ones(1), self.best, mode.chi2, self.log_evidence, 1.0)


def sample(model: Model, fit: Fit, rng: np.random.Generator) -> Posterior:
    """The posterior of a model, begun about its ``fit``, by as many points as it needs."""
    mixture: list[Component] = [
        (mode.logits, np.asarray(1.5 * np.linalg.inv(mode.curvature))) for mode in fit.modes
    ]
    mixtures: list[list[Component]] = []
    logits, heights, density = np.empty((0, len(model.low))), np.empty(0), np.empty(0)
    for _ in range(ROUNDS):
        mixtures.append(mixture)
        drawn = _drawn(mixture, rng)
        height = _log_posterior(model, drawn)
        # each point is weighed by all mixtures, so that none that missed a part has it weigh much
        before = np.logaddexp(density, _log_density(logits, mixture))
        own = logsumexp([_log_density(drawn, each) for each in mixtures], axis=0)
        logits, heights = np.vstack([logits, drawn]), np.append(heights, height)
        density = np.append(before, own)
        log_weight = heights - density + np.log(len(mixtures))
        total = float(logsumexp(log_weight))
        weights = np.exp(log_weight - total) if np.isfinite(total) else np.zeros(len(logits))
        # none is possible where all that fits well has no room
        effective = 1 / float((weights**2).sum()) if weights.any() else 0.0
        if effective >= ENOUGH or not weights.any():
            break
        if np.isfinite(height).any():
            mixture = _fitted(drawn, height - _log_density(drawn, mixture))
    possible = np.isfinite(heights)
    return Posterior(
        model.at(logits[possible]), weights[possible], fit.best, fit.modes[0].chi2,
        total - np.log(len(logits)), effective,
    )  # fmt: skip


def laplace(model: Model) -> Fit:
    """The posterior as Gaussians about its modes (Laplace's approximation)."""
    modes = _modes(model)
    heights = [
        model.log_norm - mode.cost - 0.5 * np.linalg.slogdet(mode.curvature / (2 * np.pi))[1]
        for mode in modes
    ]
    return Fit(model.at(modes[0].logits[None])[0], float(logsumexp(heights)), modes)


Component = tuple[Array, Array]
"""Middle (p,) and covariance (p, p) of a proposal, in logits."""


def _modes(model: Model) -> list[Mode]:
    """Those that matter, the highest first."""
    begin = (model.starts - model.low) / (model.high - model.low)
    modes = sorted(_climbed(model, logit(np.clip(begin, 0.02, 0.98))), key=lambda mode: mode.cost)
    distinct = modes[:1]
    for mode in modes[1:]:
        near = any(np.abs(expit(mode.logits) - expit(m.logits)).max() < NEAR for m in distinct)
        if mode.cost < modes[0].cost + LOWER and not near:
            distinct.append(mode)
    return distinct[:MODES]


def _climbed(model: Model, logits: Array) -> list[Mode]:
    """From all starts (s, p) at once by Levenberg and Marquardt's damped steps (Nocedal and Wright
    2006, Numerical Optimization, section 10.3)."""
    at = _Quadratic.about(model, logits)
    damping, of_itself = np.full(len(logits), FIRST_DAMPING), np.eye(logits.shape[1])
    for _ in range(STEPS):
        damped = at.curvature + damping[:, None, None] * of_itself * (1 + at.curvature)
        step = -np.linalg.solve(damped, at.slope[..., None])[..., 0]
        foreseen = -(at.slope * step).sum(axis=1)
        if (foreseen < LEAST_STEP).all():
            break
        tried = _Quadratic.about(model, at.logits + step)
        better = tried.cost < at.cost
        at = _Quadratic(*(
            np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
            for new, old in zip(tried, at, strict=True)
        ))  # fmt: skip
        damping *= np.where(better, 1 / CHANGE, CHANGE)
    return [Mode(*mode) for mode in zip(at.logits, at.chi2, at.cost, at.curvature, strict=True)]


class _Quadratic(NamedTuple):
    """A posterior about logits (s, p): chi-squares (s,), less its log (s,), that one's slopes (s,
    p) and curvatures (s, p, p), as where residuals are linear."""

    logits: Array
    chi2: Array
    cost: Array
    slope: Array
    curvature: Array

    @classmethod
    def about(cls, model: Model, logits: Array) -> Self:
        count, size = logits.shape
        moved = logits[:, None] + STEP * np.vstack([np.zeros(size), np.eye(size)])
        misfit = model.misfit(model.at(moved.reshape(-1, size))).reshape(count, size + 1, -1)
        residual, share = misfit[:, 0], expit(logits)
        along = (misfit[:, 1:] - misfit[:, :1]) / STEP
        chi2 = (residual**2).sum(axis=1)
        prior = 2 * share * (1 - share)
        return cls(
            logits, chi2, chi2 / 2 - _log_prior(logits),
            np.einsum("spn,sn->sp", along, residual) + 2 * share - 1,
            along @ along.swapaxes(1, 2) + prior[:, None, :] * np.eye(size),
        )  # fmt: skip


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
        if 1 / (weights**2).sum() >= MIN_POINTS * size or power < 1e-4:
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
