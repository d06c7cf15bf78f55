"""How deep, how large and how stiff a named object is, from whole rows: ramps, levels, pulses."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from probe.core.recording import Recording
from probe.detection.beneath.hypotheses import Likelihood
from probe.detection.beneath.narrowing import ALONE, TwoRows, narrowed
from probe.detection.beneath.posterior import Model, Posterior, sample
from probe.detection.beneath.rivals import (
    Likeliest,
    decided,
    likeliest,
    may_be,
    object_of,
    pairs_with,
)
from probe.detection.beneath.row_data import row_data
from probe.detection.beneath.stated import FEWEST, WORST, Misfit, sizes
from probe.detection.finding import ObjectFinding
from probe.detection.priors import DEFAULT, Priors
from probe.detection.pulse.presses import Press
from probe.detection.sizes import Sizes, unknown
from probe.detection.unequal_depths import usual_depth_m
from sim_backend.scene.scene_file import Scene
from sim_backend.touch.kept import table_for
from sim_backend.touch.table import TouchTable

SAMPLERS = 3
"""Tried one after the other: for a vessel one in twelve has too few effective points."""
FEWEST_PLACES = 3
"""Of which one may be over what lies there, beside the others."""
MOST = 2
"""Bodies of a row whose sizes are asked for."""
NO_ROOM = "the row has no room for it"


class Known(NamedTuple):
    """The block that was scanned, its finger's touch table, and what is believed beforehand."""

    scene: Scene
    table: TouchTable
    face_m2: float
    priors: Priors

    def row(self, presses: Sequence[Press]) -> Likelihood | str:
        """Of what presses of one row measured, or why there is none."""
        if usual_depth_m(presses) is not None:
            return "its presses are not equally deep: press to one depth, without scan.force_n"
        data = row_data(presses, self.face_m2)
        if data is None:
            return "the run holds no ramps with places and depths"
        if len(np.unique(data.x_m)) < FEWEST_PLACES:
            return f"a row of at least {FEWEST_PLACES} stations is needed"
        likelihood = Likelihood(data, self.table, self.scene, self.priors)
        deepest = self.table.depths[1]
        if likelihood.sunk[-1] > 1.01 * deepest:
            deepest_mm = 1e3 * deepest * likelihood.half_width_m
            return f"the table of this finger ends at {deepest_mm:.3g} mm: press less deep"
        return likelihood


def with_sizes(
    recording: Recording, rows: Sequence[Sequence[Press]], objects: list[ObjectFinding],
    priors: Priors = DEFAULT,
) -> list[ObjectFinding]:  # fmt: skip
    """The objects of a scan with their sizes; in place of a single one of a lone row that no single
    body explains, the two that do. Over a grid each has those of the row in which it is clearest.

    ``rows`` are the presses in which objects were looked for row by row, none of an area.
    """
    known = known_block(recording, priors)
    if isinstance(known, str):
        return [replace(thing, sizes=unknown(known)) for thing in objects]
    if len(rows) == 1:
        return _in_row(objects, known.row(rows[0]), recording.face_m2)
    by_y = {row[0].station.y_m: row for row in rows}
    return [replace(thing, sizes=_in_grid(thing, objects, by_y, known)) for thing in objects]


class Explained(NamedTuple):
    """The objects of a row as the bodies that were ``chosen`` say they are, and these bodies'
    posterior, or why it has none."""

    objects: list[ObjectFinding]
    chosen: Likeliest
    posterior: Posterior | Misfit | None


def explain_row(
    objects: Sequence[ObjectFinding], likelihood: Likelihood, face_m2: float
) -> Explained | str:
    """Which bodies the objects of a row are, or why that is not asked. A single one that no single
    body explains becomes two, if two do."""
    objects = sorted(objects, key=lambda thing: thing.position_m)
    may = [may_be(thing, likelihood.data.x_m) for thing in objects]
    if not 0 < len(objects) <= MOST or not all(may):
        return "it has no kind yet" if len(objects) == 1 else "what lies beside it is not known"
    chosen = likeliest(product(*may), likelihood)
    if chosen is None:
        return NO_ROOM
    count = len(likelihood.measured)
    posterior = explained(chosen.model, count)
    if isinstance(posterior, Misfit) and len(objects) == 1:
        pair = likeliest(pairs_with(may[0]), likelihood)
        of_pair = explained(pair.model, count) if pair else None
        if pair and isinstance(of_pair, Posterior):
            chosen, posterior = pair, of_pair
            name = objects[0].kind
            objects = [
                object_of(n, pair.bodies, float(p), of_pair, likelihood, face_m2, name)
                for n, p in enumerate(pair.vessel)
            ]
    elif isinstance(posterior, Posterior) and len(objects) > 1:
        objects = [
            decided(thing, float(p)) for thing, p in zip(objects, chosen.vessel, strict=True)
        ]
    return Explained(objects, chosen, posterior)


def _in_row(
    objects: Sequence[ObjectFinding], likelihood: Likelihood | str, face_m2: float
) -> list[ObjectFinding]:
    said = likelihood if isinstance(likelihood, str) else explain_row(objects, likelihood, face_m2)
    if isinstance(said, str) or isinstance(likelihood, str):
        return [replace(thing, sizes=unknown(str(said))) for thing in objects]
    return [
        replace(thing, sizes=sizes(said.chosen.bodies, n, said.posterior, likelihood))
        for n, thing in enumerate(said.objects)
    ]


def _in_grid(
    thing: ObjectFinding, objects: Sequence[ObjectFinding], rows: Mapping[float, Sequence[Press]],
    known: Known,
) -> Sizes:  # fmt: skip
    """By the row in which it is clearest; of a vessel that is narrowed there and open under another
    row, by both."""
    course = {y_m: x_m for x_m, y_m in thing.course if y_m in rows}
    if not course:
        return unknown("depth and size are known of rows of stations")
    ends_m = thing.stenosed_m or tuple(course)
    inside = [y_m for y_m in course if min(ends_m) <= y_m <= max(ends_m)]
    y_m = min(inside, key=lambda y_m: abs(course[y_m] - thing.position_m))
    likelihood = known.row(rows[y_m])
    if isinstance(likelihood, str):
        return unknown(likelihood)
    healthy = sorted(set(course) - set(inside), key=lambda y_m: _most_pa(rows[y_m]))
    open_row = known.row(rows[healthy[-1]]) if healthy else None
    if isinstance(open_row, Likelihood) and len(objects) == 1:
        return narrowed_sizes(TwoRows(likelihood, open_row))
    here = [
        replace(other, position_m=x_m) for other in objects for x_m, y in other.course if y == y_m
    ]
    sized = _in_row(here, likelihood, known.face_m2)
    return min(sized, key=lambda other: abs(other.position_m - course[y_m])).sizes


def narrowed_sizes(both: TwoRows) -> Sizes:
    """What a row over a narrowing and one over the open vessel say of it."""
    model = both.model()
    if model is None:
        return unknown(NO_ROOM)
    posterior = explained(model, both.count)
    if isinstance(posterior, Posterior):
        posterior = replace(posterior, points=narrowed(posterior.points))
    return sizes(ALONE, 0, posterior, both.narrowed_row, rows=2)


def _most_pa(presses: Sequence[Press]) -> float:
    """The largest pulse of a row."""
    return max((press.size_pa for press in presses if press.pulse is not None), default=0.0)


def explained(model: Model, count: int) -> Posterior | Misfit | None:
    """The posterior of a model of ``count`` measured numbers; None where it could not be sampled
    well enough."""
    for seed in range(SAMPLERS):
        posterior = sample(model, np.random.default_rng(seed))
        freedom = count - len(posterior.best)
        if chdtrc(freedom, posterior.chi2) < WORST:
            return Misfit(posterior.chi2, freedom)
        if posterior.effective >= FEWEST:
            return posterior
    return None


def known_block(recording: Recording, priors: Priors = DEFAULT) -> Known | str:
    """What a scan was of, or why depth and size cannot be known."""
    if recording.block is None:
        return (
            "finger and block are not known: give a scene with them as [scene] in the rig file, or "
            "to `palpate import` as --scene"
        )
    if not recording.block.get("tissue"):
        return "depth and size are known of what lies in a block of tissue"
    scene = Scene.model_validate({"name": "block", **recording.block})
    table = table_for(scene)
    if table is None:
        return f'there is no table for this finger on this support in plane = "{scene.plane}"'
    if not table.knows(scene):
        return "the block is flatter, higher, narrower or wider than those of this finger's table"
    return Known(scene, table, recording.face_m2, priors)
