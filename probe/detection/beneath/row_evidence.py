"""The one object of a lone row by the evidence of all that its presses measured."""

from collections.abc import Sequence
from typing import NamedTuple

from probe.core.finding_words import AT_AN_END, percent
from probe.core.recording import Recording
from probe.detection.beneath.explain import known_block
from probe.detection.beneath.hypotheses import Likelihood
from probe.detection.beneath.rivals import at_an_end, object_of
from probe.detection.beneath.stated import sizes
from probe.detection.beneath.weighed import NOTHING, Weighed, weighed
from probe.detection.classify.kinds import ELSE, EVEN, MIN_POSTERIOR
from probe.detection.finding import LUMP, NAMED, UNDECIDED, VESSELS, ObjectFinding, stated
from probe.detection.priors import DEFAULT, Priors
from probe.detection.pulse.presses import Press, chance_of_pulse
from probe.detection.repeats import MIN_NAMED
from sim_backend.touch.kinds import LUMP as A_LUMP
from sim_backend.touch.kinds import VESSEL


class RowEvidence(NamedTuple):
    """What is said of a row: its object, None where nothing lies there as far as is known; and all
    hypotheses."""

    thing: ObjectFinding | None
    hypotheses: Weighed
    likelihood: Likelihood


def by_evidence(
    recording: Recording, rows: Sequence[Sequence[Press]], objects: Sequence[ObjectFinding],
    priors: Priors,
) -> list[ObjectFinding] | None:  # fmt: skip
    """In place of the ``objects`` of a lone row whose levels name none, or are too few to: what all
    that its presses measured says; None where it says no more."""
    if len(rows) != 1 or len(objects) > 1:
        return None
    short = len({press.station.x_m for press in rows[0]}) < MIN_NAMED
    if not short and any(thing.is_named for thing in objects):
        return None
    said = row_evidence(recording, rows[0], priors)
    if said is None or not (short or (said.thing and said.thing.is_named)):
        return None
    return [said.thing] if said.thing else []


def row_evidence(
    recording: Recording, presses: Sequence[Press], priors: Priors = DEFAULT
) -> RowEvidence | None:
    """Of the ``presses`` of a lone row. None where block and finger or the presses' depths are not
    known, or where neither a single body nor nothing explains the row."""
    known = known_block(recording, priors)
    likelihood = known if isinstance(known, str) else known.row(presses)
    if isinstance(likelihood, str):
        return None
    row = weighed(likelihood)
    if row is None or not row.posteriors:
        return None
    chances = row.chances
    if chances[ELSE] > MIN_POSTERIOR or (row.misfit and chances[NOTHING] < MIN_POSTERIOR):
        return None
    if chances[NOTHING] >= MIN_POSTERIOR:
        return RowEvidence(None, row, likelihood)
    return RowEvidence(
        _thing(row, likelihood, chance_of_pulse(presses), recording.face_m2), row, likelihood
    )


def _thing(
    row: Weighed, likelihood: Likelihood, moving: float | None, face_m2: float
) -> ObjectFinding:
    """The likeliest body; ``moving`` is the chance that what moves is a pulse. Whether a vessel is
    healthy is judged by its bump and its pulse."""
    vessel = row.chances[VESSEL.name] / row.body
    bodies, posterior = next(iter(row.posteriors.values()))
    thing = object_of(0, bodies, 1.0, posterior, likelihood, face_m2, LUMP)
    of_vessels = sum(thing.chances[name] for name in VESSELS)
    pulse = 1.0 if moving is None else moving
    share: dict[str, float] = {
        name: pulse * row.body * vessel * thing.chances[name] / max(of_vessels, 1e-300)
        for name in VESSELS
    }
    share |= {LUMP: row.chances[A_LUMP.name], ELSE: row.chances[ELSE]}
    share[NOTHING] = 1 - sum(share.values())
    kind = max(NAMED, key=lambda name: share[name])
    reason = ""
    if share[kind] < MIN_POSTERIOR:
        said = ", ".join(f"{k} {percent(stated(p))}" for k, p in share.items() if p >= 0.005)
        reason = f"{EVEN}{said}; press beside it, or hold for more beats"
    if at_an_end(thing.position_m, likelihood.data.x_m):
        reason = AT_AN_END
    return ObjectFinding(
        UNDECIDED if reason else kind, thing.position_m, thing.position_ci_m, thing.peak_pa,
        thing.pulse_pa, stated(share[kind]), reason, diseased=thing.diseased,
        p_stiff=thing.p_stiff if vessel > 0.5 else float("nan"), chances=share,
        contrast=thing.contrast, pulse_share=thing.pulse_share,
        sizes=sizes(bodies, 0, posterior, likelihood),
    )  # fmt: skip
