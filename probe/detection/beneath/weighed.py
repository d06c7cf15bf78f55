"""What lies beneath a row by all that it measured: nothing, a body, or what no body explains.

The map of levels needs a row of `MIN_NAMED` stations: the shape of a bump is all that it asks. Here
each hypothesis predicts every force along the ramp and every pulse, so that three presses may tell.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, logsumexp

from probe.detection.beneath.hypotheses import Bodies, Likelihood
from probe.detection.beneath.posterior import Model, Posterior, laplace, sample
from probe.detection.beneath.stated import WORST, Misfit
from probe.detection.classify.kinds import ELSE, PRIOR
from probe.detection.finding import LUMP as A_LUMP
from sim_backend.touch.kinds import KINDS, Kind

NOTHING = "nothing"
UNEVEN = 0.1
"""Standard deviation of a share of the force that is smooth along the row and in depth: what
layers, a bone or several bodies may do. With 0.05 and 0.2, each half of it, all of 64 rows
(nothing, a lump, a stenosis, two objects) have the same likeliest hypothesis."""
HOPELESS = 25.0
"""By how much [nat] Laplace's evidence is below the greatest of a kind that is not sampled; in 24
rows sampling moves it by 11 at most."""


@dataclass(frozen=True)
class Weighed:
    """Posterior probabilities ``chances`` of `NOTHING`, of `ELSE`, and of each kind of body by its
    name; ``posteriors`` those of the kinds for which there is room, the likeliest first, and
    ``misfit`` that of the likeliest, if it is more than chance's."""

    chances: Mapping[str, float]
    posteriors: Mapping[str, tuple[Bodies, Posterior]]
    misfit: Misfit | None

    @property
    def body(self) -> float:
        """The probability that a body lies there."""
        return sum(self.chances[kind.name] for kind in KINDS)


def prior_of(kind: Kind) -> float:
    """Of a body that may be a vessel of any name, as `PRIOR` has them, or a lump."""
    lump = PRIOR[A_LUMP]
    return 1 - lump - PRIOR[ELSE] if kind.beats else lump


def weighed(likelihood: Likelihood) -> Weighed | None:
    """Weigh a row's hypotheses against each other; None where it has room for no body.

    Nothing is as likely beforehand as anything.
    """
    logs = {NOTHING: _without_body(likelihood, 0.0)}
    logs[ELSE] = np.log(PRIOR[ELSE]) + _without_body(likelihood, UNEVEN)
    firsts = {kind.name: (Bodies((kind,)), likelihood.model(Bodies((kind,)))) for kind in KINDS}
    fits = {name: (bodies, laplace(model).best) for name, (bodies, model) in firsts.items()
            if len(model.starts)}  # fmt: skip
    if not fits:
        return None
    errors = {name: likelihood.table_error(bodies, best) for name, (bodies, best) in fits.items()}
    # all kinds are off alike, or what is known worse loses by that; but a lump does not pulse where
    # a pulse is seen
    seen = likelihood.data.pulse_n.any()
    part = slice(0, likelihood.bare.size if seen else None)
    alike = np.mean([error[part, part] for error in errors.values()], axis=0)
    models: dict[str, tuple[Bodies, Model]] = {}
    for name, (bodies, best) in fits.items():
        errors[name][part, part] = alike
        models[name] = bodies, likelihood.model(bodies, best, errors[name])
    for kind in KINDS:
        known = models.get(kind.name)
        evidence = laplace(known[1]).log_evidence if known else -np.inf
        logs[kind.name] = np.log(prior_of(kind)) + evidence
    likely = max(logs.values()) - HOPELESS
    posteriors: dict[str, tuple[Bodies, Posterior]] = {}
    for kind in KINDS:
        if logs[kind.name] > likely:
            bodies, model = models[kind.name]
            posterior = sample(model, np.random.default_rng(0))
            if posterior.effective:
                posteriors[kind.name] = bodies, posterior
            logs[kind.name] = np.log(prior_of(kind)) + posterior.log_evidence
    total = logsumexp(list(logs.values()))
    chances = {name: float(np.exp(value - total)) for name, value in logs.items()}
    posteriors = dict(sorted(posteriors.items(), key=lambda item: -logs[item[0]]))
    return Weighed(chances, posteriors, _misfit(likelihood, posteriors.values()))


def _without_body(likelihood: Likelihood, uneven: float) -> float:
    """The log of the evidence of a bare block."""
    none = Bodies(())
    first = laplace(likelihood.model(none, uneven=uneven))
    return laplace(likelihood.model(none, first.best, uneven=uneven)).log_evidence


def _misfit(
    likelihood: Likelihood, posteriors: Iterable[tuple[Bodies, Posterior]]
) -> Misfit | None:
    """Of the first one, where it is more than chance's."""
    for _, posterior in posteriors:
        freedom = len(likelihood.measured) - len(posterior.best)
        if chdtrc(freedom, posterior.chi2) >= WORST:
            return None
        return Misfit(posterior.chi2, freedom)
    return None
