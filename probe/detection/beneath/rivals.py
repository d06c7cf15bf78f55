"""Which bodies lie beneath a row: their evidences, and what the likeliest ones are named."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from drivers.core.arrays import Array
from probe.core.finding_words import AT_AN_END
from probe.detection.beneath.hypotheses import HYPOTHESES, Bodies, Likelihood
from probe.detection.beneath.posterior import Model, Posterior, laplace
from probe.detection.classify.kinds import EVEN, Seen, by_body, judge
from probe.detection.finding import UNDECIDED, ObjectFinding
from sim_backend.touch.kinds import KINDS, Kind

MORE_THAN_ONE = "more than one thing lies here: two bodies explain the row, and no single one does"


class Likeliest(NamedTuple):
    """Of some rivals the bodies with the most evidence, their posterior's model, and the chance
    that each of them is a vessel (n,)."""

    bodies: Bodies
    model: Model
    vessel: Array


def likeliest(rivals: Iterable[tuple[Kind, ...]], likelihood: Likelihood) -> Likeliest | None:
    """Compare bodies of some kinds, all alike beforehand, by the evidence of a row; None where it
    has room for none of them."""
    firsts = [(bodies, likelihood.model(bodies)) for bodies in map(Bodies, rivals)]
    firsts = [(bodies, model) for bodies, model in firsts if len(model.starts)]
    if not firsts:
        return None
    each = [bodies for bodies, _ in firsts]
    models = [likelihood.model(bodies, laplace(model).best) for bodies, model in firsts]
    evidence = [laplace(model).log_evidence for model in models] if len(each) > 1 else [0.0]
    beats = np.array([[kind.beats for kind in bodies.kinds] for bodies in each])
    best = int(np.argmax(evidence))
    return Likeliest(each[best], models[best], softmax(evidence) @ beats)


def may_be(thing: ObjectFinding, row_m: Array) -> tuple[Kind, ...]:
    """The kinds of body that an object may be: that of its name, or each where only its chances are
    too even to name it; none where it is undecided for another reason, as at an end of the row."""
    if thing.kind in HYPOTHESES:
        return (HYPOTHESES[thing.kind],)
    even = thing.reason.startswith(EVEN) and not at_an_end(thing.position_m, row_m)
    return KINDS if even else ()


def at_an_end(x_m: float, row_m: Array) -> bool:
    return int(np.argmin(np.abs(np.sort(row_m) - x_m))) in (0, len(row_m) - 1)


def pairs_with(kinds: tuple[Kind, ...]) -> list[tuple[Kind, ...]]:
    """Two bodies, one of them of one of these kinds."""
    return [pair for pair in product(KINDS, KINDS) if set(pair) & set(kinds)]


def decided(thing: ObjectFinding, vessel: float) -> ObjectFinding:
    """An undecided object, where the chance that it is a ``vessel`` decides its kind."""
    said = by_body(thing.chances, vessel) if not thing.is_named else None
    if said is None:
        return thing
    kind, confidence, chances = said
    return replace(thing, kind=kind, confidence=confidence, chances=chances, reason="")


def object_of(
    n: int, bodies: Bodies, vessel: float, posterior: Posterior, likelihood: Likelihood,
    face_m2: float, named: str,
) -> ObjectFinding:  # fmt: skip
    """The ``n``-th of some bodies in place of an object ``named`` so, judged by its own bump and
    pulse, a ``vessel`` with that chance: no other name is given, since a bone or a layer may be
    taken for a second body."""
    at = likelihood.half_width_m * posterior.points[:, bodies.column(n, "x")]
    low_m, at_m, high_m = likelihood.middle_m + posterior.quantiles(at)
    bare_n, bump, pulse = likelihood.over(bodies, n, posterior.points)

    def known(values: Array) -> tuple[float, float]:
        mean = float(posterior.weights @ values)
        return mean, float(np.sqrt(posterior.weights @ (values - mean) ** 2))

    contrast, share = known(bump), known(pulse / (1 + bump))
    said = judge(Seen(*share, *contrast, moving=vessel))
    if said.kind != named:
        said = replace(said, kind=UNDECIDED, reason=MORE_THAN_ONE)
    if at_an_end(float(at_m), likelihood.data.x_m):
        said = replace(said, kind=UNDECIDED, reason=AT_AN_END)
    return ObjectFinding(
        said.kind, float(at_m), (float(low_m), float(high_m)), known(bump * bare_n)[0] / face_m2,
        known(pulse * bare_n)[0] / face_m2, said.confidence, said.reason or MORE_THAN_ONE,
        diseased=said.diseased, p_stiff=said.stiff, chances=said.chances, contrast=contrast,
        pulse_share=share,
    )  # fmt: skip
