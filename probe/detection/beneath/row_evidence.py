"""The objects of a row by the evidence of all that its presses measured."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from drivers.core.arrays import Array
from probe.core.finding_words import AT_AN_END, percent
from probe.core.recording import Recording
from probe.detection.beneath.hypotheses import Bodies, Likelihood
from probe.detection.beneath.known import known_block
from probe.detection.beneath.posterior import Posterior
from probe.detection.beneath.stated import sizes, why_unknown
from probe.detection.beneath.weighed import MOST, NOTHING, Weighed, weighed
from probe.detection.classify.kinds import (
    ELSE,
    EVEN,
    MIN_POSTERIOR,
    REASONS,
    SIZES,
    UNEVEN_ROW,
    Seen,
    judge,
)
from probe.detection.finding import LUMP, NAMED, UNDECIDED, VESSELS, ObjectFinding, stated
from probe.detection.map.unseen_pulse import MIN_SHARE
from probe.detection.priors import DEFAULT, Priors
from probe.detection.pulse.pooled_evidence import hidden
from probe.detection.pulse.presses import Press, chance_of_pulse
from sim_backend.touch.kinds import aside

NONE = "nothing"
NO_ROOM = "the row has no room for a body"


class RowEvidence(NamedTuple):
    """What is said of a row: its objects, none where nothing lies there as far as is known; the
    bodies that these are, and all hypotheses."""

    objects: list[ObjectFinding]
    bodies: Bodies
    hypotheses: Weighed
    likelihood: Likelihood


def row_evidence(
    recording: Recording, presses: Sequence[Press], priors: Priors = DEFAULT
) -> RowEvidence | str:
    """Of the ``presses`` of a row, or why there is none: block, finger or the presses' depths are
    not known, or no body explains the row."""
    known = known_block(recording, priors)
    likelihood = known if isinstance(known, str) else known.row(presses)
    if isinstance(likelihood, str):
        return likelihood
    moving = chance_of_pulse(presses)
    return evidence_of(likelihood, 1.0 if moving is None else moving, recording.face_m2)


def evidence_of(likelihood: Likelihood, moving: float, face_m2: float) -> RowEvidence | str:
    """Of a row over a known block; ``moving`` is the chance that what moves is a pulse."""
    row = weighed(likelihood)
    if row is None:
        return NO_ROOM
    if row.of(0) >= MIN_POSTERIOR:
        return RowEvidence([], NOTHING, row, likelihood)
    may_be = [count for count in range(1, MOST + 1) if row.of(count) > 1 - MIN_POSTERIOR]
    count = max(may_be, default=1)
    bodies = next((b for b in row.posteriors if len(b.kinds) == count), NOTHING)
    if row.misfit is not None:
        return why_unknown(row.misfit)
    if row.otherwise >= MIN_POSTERIOR or not bodies.kinds:
        return REASONS[UNEVEN_ROW]
    objects = [_object(n, bodies, row, likelihood, moving, face_m2) for n in range(count)]
    return RowEvidence(objects, bodies, row, likelihood)


def _object(
    n: int, bodies: Bodies, row: Weighed, likelihood: Likelihood, moving: float, face_m2: float
) -> ObjectFinding:
    """The ``n``-th body. Which kind it is, is judged by its bump and its pulse; but whether it is a
    vessel by the evidence of the row, if anything beats there."""
    posterior = row.posteriors[bodies]
    low_m, at_m, high_m = likelihood.place_m(bodies, n, posterior)
    over = likelihood.over(bodies, n, posterior)
    contrast = _known(posterior, over.bump, over.bump_sd)
    pulse_share = _known(posterior, over.beat, over.beat_sd)
    lump, vessel = (row.there(n, bodies, beats) for beats in (False, True))
    if likelihood.data.pulse_n.any():
        said = judge(Seen(*pulse_share, *contrast))
        of_kinds = {LUMP: lump} | _shared(vessel * moving, VESSELS, said.chances)
    else:
        said = judge(
            Seen(0.0, 0.0, *contrast, hidden=_hidden(n, bodies, posterior, likelihood, face_m2))
        )
        of_kinds = _shared(lump + vessel, NAMED, said.chances)
    chances: dict[str, float] = {**of_kinds, NONE: row.of(0)}
    chances[ELSE] = max(1 - sum(chances.values()), 0.0)
    any_vessel = sum(chances[name] for name in VESSELS)
    kind = max(NAMED, key=lambda name: chances[name])
    reason = ""
    if at_an_end(at_m, likelihood.data.x_m):
        reason = AT_AN_END
    elif chances[kind] < MIN_POSTERIOR:
        rivals = ", ".join(f"{k} {percent(stated(p))}" for k, p in chances.items() if p >= 0.005)
        reason = f"{EVEN}{rivals}; press beside it, or hold for more beats"
    return ObjectFinding(
        UNDECIDED if reason else kind, at_m, (low_m, high_m),
        posterior.mean(over.bump * over.bare_n) / face_m2,
        posterior.mean(over.beat * (1 + over.bump) * over.bare_n) / face_m2,
        stated(chances[kind]), reason,
        diseased=said.diseased, p_stiff=said.stiff if any_vessel > chances[LUMP] else float("nan"),
        chances=chances, contrast=contrast, pulse_share=pulse_share,
        sizes=sizes(bodies, n, posterior, likelihood),
    )  # fmt: skip


def _shared(
    probability: float, kinds: Sequence[str], chances: Mapping[str, float]
) -> dict[str, float]:
    """A ``probability`` that some kinds share as their ``chances``."""
    total = max(sum(chances[kind] for kind in kinds), 1e-300)
    return {kind: probability * chances[kind] / total for kind in kinds}


def _hidden(
    n: int, bodies: Bodies, posterior: Posterior, likelihood: Likelihood, face_m2: float
) -> Array:
    """Likelihood of pulses of `SIZES` over the force at the ``n``-th body beside that of none,
    where no press shows one: it falls aside as the bump does."""
    best, data = posterior.best[None], likelihood.data
    _, falls = aside(likelihood.x, bodies.of(best, n, likelihood.block))
    wanted_n = SIZES * np.interp(bodies.places(best)[n], likelihood.x, data.force_n[:, -1])
    if not data.searches:
        return np.asarray(np.exp(-0.5 * (wanted_n * np.linalg.norm(falls / data.pulse_sd_n)) ** 2))
    felt = np.flatnonzero(falls >= min(MIN_SHARE, falls.max()))
    return hidden([data.searches[k] for k in felt], falls[felt], wanted_n / face_m2)


def _known(posterior: Posterior, values: Array, sd: Array) -> tuple[float, float]:
    """Mean and standard deviation of what has these values (m,) at a posterior's points, each give
    or take its ``sd`` (m,)."""
    mean = posterior.mean(values)
    return mean, float(np.sqrt(posterior.mean((values - mean) ** 2 + sd**2)))


def at_an_end(x_m: float, row_m: Array) -> bool:
    """Whether the station nearest to ``x_m`` is the first or the last of a row (n,)."""
    return int(np.argmin(np.abs(np.sort(row_m) - x_m))) in (0, len(row_m) - 1)
