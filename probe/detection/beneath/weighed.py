"""What lies beneath a row by all that it measured: nothing, bodies, or what no body explains.

The map of levels needs a row of `MIN_NAMED` stations: the shape of a bump is all that it asks. Here
each hypothesis predicts every force along the ramp and every pulse, so that three presses may tell,
and two bodies are told from one.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from drivers.core.arrays import Array
from probe.detection.beneath.hypotheses import MIN_DISTANCE, Bodies, Likelihood
from probe.detection.beneath.posterior import Fit, Posterior, laplace, sample
from probe.detection.beneath.stated import Misfit, misfit_of
from probe.detection.classify.kinds import ELSE, PRIOR
from probe.detection.finding import LUMP as A_LUMP
from sim_backend.touch.kinds import KINDS

MOST = 2
"""Bodies that a row is asked for; more are what no body explains."""
NOTHING = Bodies(())
HYPOTHESES = tuple(
    Bodies(kinds) for count in range(MOST + 1) for kinds in product(KINDS, repeat=count)
)
UNEVEN = 0.1
"""Standard deviation of a share of the force that no body explains: smooth along the row and in
depth, as layers, a bone or several bodies may make it, or of one press alone, as one that goes
deeper than the stage knows. With half and twice of it all of 32 rows (nothing, a lump, an artery,
two objects; 0.5 and 5 mN) have the same likeliest hypothesis."""
UNLIKELY = 5.0
"""By how much [nat] Laplace's evidence is below the greatest of a hypothesis that is not sampled,
but counts by that evidence: of 110 in 20 rows sampling raises none by more than 2.1."""


@dataclass(frozen=True)
class Weighed:
    """Posterior probabilities ``chances`` of `HYPOTHESES` for which there is room, ``otherwise``
    that no body explains the row; ``posteriors`` of the bodies that may lie there, the likeliest
    first, and ``misfit`` that of the likeliest of all, if it is more than chance's."""

    chances: Mapping[Bodies, float]
    otherwise: float
    posteriors: Mapping[Bodies, Posterior]
    misfit: Misfit | None

    def of(self, count: int) -> float:
        """The probability of so many bodies."""
        return sum(p for bodies, p in self.chances.items() if len(bodies.kinds) == count)

    def there(self, n: int, bodies: Bodies, beats: bool) -> float:
        """The probability that the ``n``-th of ``bodies`` is a vessel, or a lump: that of all
        hypotheses of as many bodies in which the ``n``-th is one, and of the others as far as they
        have one nearer to it than bodies lie to each other."""
        own = self.posteriors[bodies]
        at, total = own.quantiles(bodies.places(own.points)[n])[1], 0.0
        for others, posterior in self.posteriors.items():
            if len(others.kinds) == len(bodies.kinds):
                share = float(others.kinds[n].beats == beats)
            else:
                near = np.abs(others.places(posterior.points) - at) < MIN_DISTANCE
                alike = [kind.beats == beats for kind in others.kinds]
                share = float((near[alike] @ posterior.weights).sum())
            total += self.chances[others] * share
        return total


def prior_of(bodies: Bodies) -> float:
    """Of each body that it may be a vessel of any name, as `PRIOR` has them, or a lump. One is
    about as likely as none, and more are as seldom as something else."""
    lump = PRIOR[A_LUMP]
    each = [1 - lump - PRIOR[ELSE] if kind.beats else lump for kind in bodies.kinds]
    return float(np.prod(each)) * PRIOR[ELSE] ** (len(each) > 1)


def weighed(likelihood: Likelihood) -> Weighed | None:
    """Weigh a row's hypotheses against each other; None where it has room for no body."""
    firsts = {bodies: likelihood.model(bodies) for bodies in HYPOTHESES}
    fits = {bodies: laplace(model) for bodies, model in firsts.items() if len(model.starts)}
    if fits.keys() == {NOTHING}:
        return None
    errors = _errors(likelihood, fits)
    likely = _in_even_row(likelihood, fits, errors)
    uneven = _uneven(likelihood, fits[NOTHING], errors[NOTHING])
    total = logsumexp([uneven, *(hypothesis.log_weight for hypothesis in likely)])
    chances = dict.fromkeys(fits, 0.0)
    for bodies, log_weight, _ in likely:
        chances[bodies] = float(np.exp(log_weight - total))
    posteriors = {bodies: posterior for bodies, _, posterior in likely if bodies.kinds}
    misfit = misfit_of(likely[0].posterior, len(likelihood.measured))
    return Weighed(chances, float(np.exp(uneven - total)), posteriors, misfit)


class _Hypothesis(NamedTuple):
    """Bodies in an even row, the log of prior and evidence, and the posterior."""

    bodies: Bodies
    log_weight: float
    posterior: Posterior


def _errors(likelihood: Likelihood, fits: Mapping[Bodies, Fit]) -> dict[Bodies, Array]:
    """What the table is off by: of forces as in the likeliest for all, or what is known worse loses
    by that; of pulses too where none is seen, but a lump has none where one is."""
    errors = {bodies: likelihood.table_error(bodies, fit.best) for bodies, fit in fits.items()}
    part = slice(0, likelihood.bare.size if likelihood.data.pulse_n.any() else None)
    likely = max(fits, key=lambda bodies: np.log(prior_of(bodies)) + fits[bodies].log_evidence)
    for error in errors.values():
        error[part, part] = errors[likely][part, part]
    return errors


def _in_even_row(
    likelihood: Likelihood, fits: Mapping[Bodies, Fit], errors: Mapping[Bodies, Array]
) -> list[_Hypothesis]:
    """All bodies for which there is room, the likeliest first. The unlikely ones are taken to lie
    where they fit best."""
    models = {bodies: likelihood.model(bodies, fit.best, errors[bodies])
              for bodies, fit in fits.items()}  # fmt: skip
    log_prior = {bodies: np.log((1 - PRIOR[ELSE]) * prior_of(bodies)) for bodies in fits}
    found = {bodies: laplace(model) for bodies, model in models.items()}
    first = {bodies: log_prior[bodies] + fit.log_evidence for bodies, fit in found.items()}
    even: list[_Hypothesis] = []
    for bodies in sorted(first, key=lambda bodies: -first[bodies]):
        model, fit = models[bodies], found[bodies]
        greatest = max((hypothesis.log_weight for hypothesis in even), default=-np.inf)
        if first[bodies] >= greatest - UNLIKELY:
            posterior = sample(model, fit, np.random.default_rng(0))
        else:
            posterior = fit.alone()
        if model.allowed(posterior.points).any():
            log_weight = log_prior[bodies] + posterior.log_evidence
            even.append(_Hypothesis(bodies, log_weight, posterior))
    return sorted(even, key=lambda hypothesis: -hypothesis.log_weight)


def _uneven(likelihood: Likelihood, bare: Fit, error: Array) -> float:
    """Log of prior and evidence of a bare block whose row is uneven: smoothly, or by any one press
    alone."""
    even, smooth = (
        laplace(likelihood.model(NOTHING, bare.best, error, uneven)).log_evidence
        for uneven in (0.0, UNEVEN**2 * likelihood.smooth())
    )
    one_press = even + likelihood.one_press(bare.best, error, UNEVEN)
    each = [smooth, logsumexp(one_press) - np.log(len(one_press))]
    return float(np.log(PRIOR[ELSE] / len(each)) + logsumexp(each))
