"""Sizes of objects that whole maps or unfinished rows showed: each by the row in which it is
clearest."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from probe.core.recording import Recording
from probe.detection.beneath.hypotheses import Likelihood
from probe.detection.beneath.known import Known, known_block
from probe.detection.beneath.narrowing import ALONE, TwoRows, narrowed
from probe.detection.beneath.posterior import laplace, sample
from probe.detection.beneath.stated import misfit_of, sizes
from probe.detection.beneath.weighed import weighed
from probe.detection.finding import ObjectFinding
from probe.detection.priors import DEFAULT, Priors
from probe.detection.pulse.presses import Press
from probe.detection.sizes import Sizes, unknown

NO_ROOM = "the row has no room for it"
NO_BODY = "by all that its row measured no such body lies there"


def with_sizes(
    recording: Recording, rows: Sequence[Sequence[Press]], objects: list[ObjectFinding],
    priors: Priors = DEFAULT,
) -> list[ObjectFinding]:  # fmt: skip
    """The objects of a scan with their sizes. ``rows`` are the presses in which objects were looked
    for row by row, none of an area."""
    known = known_block(recording, priors)
    if isinstance(known, str):
        return [replace(thing, sizes=unknown(known)) for thing in objects]
    by_y = {row[0].station.y_m: row for row in rows}
    return [
        replace(thing, sizes=_clearest(thing, by_y, known, alone=len(objects) == 1))
        for thing in objects
    ]


def _clearest(
    thing: ObjectFinding, rows: Mapping[float, Sequence[Press]], known: Known, *, alone: bool
) -> Sizes:
    """By the row in which it is clearest; of a vessel that lies ``alone`` and is narrowed there and
    open under another row, by both."""
    if len(rows) == 1:
        (row,) = rows.values()
        return _sizes_at(thing.position_m, thing, known.row(row))
    course = {y_m: x_m for x_m, y_m in thing.course if y_m in rows}
    if not course:
        return unknown("depth and size are known of rows of stations")
    ends_m = thing.stenosed_m or tuple(course)
    inside = [y_m for y_m in course if min(ends_m) <= y_m <= max(ends_m)]
    y_m = min(inside, key=lambda y_m: abs(course[y_m] - thing.position_m))
    likelihood = known.row(rows[y_m])
    healthy = sorted(set(course) - set(inside), key=lambda y_m: _most_pa(rows[y_m]))
    open_row = known.row(rows[healthy[-1]]) if healthy and alone else None
    if isinstance(likelihood, Likelihood) and isinstance(open_row, Likelihood):
        return narrowed_sizes(TwoRows(likelihood, open_row))
    return _sizes_at(course[y_m], thing, likelihood)


def _sizes_at(x_m: float, thing: ObjectFinding, likelihood: Likelihood | str) -> Sizes:
    """Those of the likeliest body at ``x_m``, a vessel if that is what the thing is named."""
    if isinstance(likelihood, str):
        return unknown(likelihood)
    row = weighed(likelihood)
    if row is None:
        return unknown(NO_ROOM)
    for bodies, posterior in row.posteriors.items():
        for n, kind in enumerate(bodies.kinds):
            fits = not thing.is_named or kind.beats == thing.is_vessel
            low_m, _, high_m = likelihood.place_m(bodies, n, posterior)
            if fits and low_m - likelihood.half_width_m < x_m < high_m + likelihood.half_width_m:
                return sizes(bodies, n, row.misfit or posterior, likelihood)
    return unknown(NO_BODY)


def narrowed_sizes(both: TwoRows) -> Sizes:
    """What a row over a narrowing and one over the open vessel say of it."""
    model = both.model()
    if model is None:
        return unknown(NO_ROOM)
    posterior = sample(model, laplace(model), np.random.default_rng(0))
    of_row = replace(posterior, points=narrowed(posterior.points))
    return sizes(ALONE, 0, misfit_of(posterior, both.count) or of_row, both.narrowed_row, rows=2)


def _most_pa(presses: Sequence[Press]) -> float:
    """The largest pulse of a row."""
    return max((press.size_pa for press in presses if press.pulse is not None), default=0.0)
