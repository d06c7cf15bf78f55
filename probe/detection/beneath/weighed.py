"""What lies beneath a row by all that it measured: nothing, bodies, or what no body explains.

The map of levels needs a row of `MIN_NAMED` stations: the shape of a bump is all that it asks. Here
each hypothesis predicts every force along the ramp and every pulse, so that three presses may tell,
and two bodies are told from one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from drivers.core.arrays import Array
from probe.detection.beneath.hypotheses import APART, Bodies, Likelihood
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
HOPELESS = 10.0
"""By how much [nat] Laplace's evidence is below the greatest of a hypothesis that is not sampled:
of 110 in 20 rows sampling raises none by more than 2.1."""


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
                near = np.abs(others.places(posterior.points) - at) < APART
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
    """Weigh a row's hypotheses against each other; None where it has room for no body.

    Bodies in a smoothly uneven row are asked for only where an even one leaves too much
    unexplained: elsewhere they have next to no evidence.
    """
    firsts = {bodies: likelihood.model(bodies) for bodies in HYPOTHESES}
    fits = {bodies: laplace(model) for bodies, model in firsts.items() if len(model.starts)}
    if fits.keys() == {NOTHING}:
        return None
    found = _hypotheses(likelihood, fits)
    total = logsumexp([hypothesis.log_weight for hypothesis in found])
    chances, otherwise = dict.fromkeys(fits, 0.0), 0.0
    posteriors: dict[Bodies, Posterior] = {}
    for bodies, uneven, log_weight, posterior in found:
        chance = float(np.exp(log_weight - total))
        if bodies.kinds:
            posteriors.setdefault(bodies, posterior)
        if bodies.kinds or not uneven:
            chances[bodies] += chance
        else:
            otherwise += chance
    return Weighed(chances, otherwise, posteriors, _misfit(likelihood, found))


class _Hypothesis(NamedTuple):
    """Bodies in an even or ``uneven`` row, the log of prior and evidence, and the posterior."""

    bodies: Bodies
    uneven: bool
    log_weight: float
    posterior: Posterior


def _hypotheses(likelihood: Likelihood, fits: Mapping[Bodies, Fit]) -> list[_Hypothesis]:
    """All that are not hopeless, the likeliest first."""
    errors = _errors(likelihood, fits)
    presses, seldom = len(likelihood.x), PRIOR[ELSE] / 2
    smooth = UNEVEN**2 * likelihood.smooth()
    found = _in_row(likelihood, fits, errors, 0.0, 1 - PRIOR[ELSE])
    nothing = {NOTHING: fits[NOTHING]}
    found += _in_row(likelihood, nothing, errors, smooth, seldom)
    for n in range(presses):
        alone = UNEVEN**2 * likelihood.one_press(n)
        found += _in_row(likelihood, nothing, errors, alone, seldom / presses)
    if _misfit(likelihood, found) is not None:
        something = {bodies: fit for bodies, fit in fits.items() if bodies.kinds}
        found += _in_row(likelihood, something, errors, smooth, seldom)
    return sorted(found, key=lambda hypothesis: -hypothesis.log_weight)


def _errors(likelihood: Likelihood, fits: Mapping[Bodies, Fit]) -> dict[Bodies, Array]:
    """What the table is off by: of forces as in the likeliest for all, or what is known worse loses
    by that; of pulses too where none is seen, but a lump has none where one is."""
    errors = {bodies: likelihood.table_error(bodies, fit.best) for bodies, fit in fits.items()}
    part = slice(0, likelihood.bare.size if likelihood.data.pulse_n.any() else None)
    likely = max(fits, key=lambda bodies: np.log(prior_of(bodies)) + fits[bodies].log_evidence)
    for error in errors.values():
        error[part, part] = errors[likely][part, part]
    return errors


def _in_row(
    likelihood: Likelihood, fits: Mapping[Bodies, Fit], errors: Mapping[Bodies, Array],
    uneven: Array | float, prior: float,
) -> list[_Hypothesis]:  # fmt: skip
    """What may lie beneath a row that is ``uneven`` so, and is not hopeless."""
    models = {bodies: likelihood.model(bodies, fit.best, errors[bodies], uneven)
              for bodies, fit in fits.items()}  # fmt: skip
    log_prior = {bodies: np.log(prior * prior_of(bodies)) for bodies in fits}
    first = {bodies: log_prior[bodies] + laplace(model).log_evidence
             for bodies, model in models.items()}  # fmt: skip
    found: list[_Hypothesis] = []
    for bodies in sorted(first, key=lambda bodies: -first[bodies]):
        if first[bodies] < max((one.log_weight for one in found), default=-np.inf) - HOPELESS:
            break
        posterior = sample(models[bodies], np.random.default_rng(0))
        if posterior.effective:  # there is room for what fits
            log_weight = log_prior[bodies] + posterior.log_evidence
            found.append(_Hypothesis(bodies, bool(np.any(uneven)), log_weight, posterior))
    return found


def _misfit(likelihood: Likelihood, found: Sequence[_Hypothesis]) -> Misfit | None:
    """Of the likeliest hypothesis."""
    likely = max(found, key=lambda hypothesis: hypothesis.log_weight)
    return misfit_of(likely.posterior, len(likelihood.measured))
