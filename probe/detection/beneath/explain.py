"""How deep, how large and how stiff a named object is, from a whole row: ramps, levels, pulses."""

from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc

from probe.core.recording import Recording
from probe.detection.beneath.hypotheses import Bodies, Likelihood
from probe.detection.beneath.posterior import Posterior, sample
from probe.detection.beneath.rivals import (
    Likeliest,
    decided,
    likeliest,
    may_be,
    object_of,
    pairs_with,
)
from probe.detection.beneath.row_data import row_data
from probe.detection.finding import ObjectFinding
from probe.detection.pulse.presses import Press
from probe.detection.repeats import MIN_NAMED
from probe.detection.sizes import Sizes, unknown
from sim_backend.scene.scene_file import Scene
from sim_backend.touch.kept import table_for

WORST = 0.01
"""Chance of a greater misfit, below which the body in the table is not what lies there."""
FEWEST = 100.0
"""Effective points of a posterior whose 95 % interval is stated; with 100 its ends scatter
by a tenth of its width."""
SAMPLERS = 3
"""Tried one after the other: for a vessel one in twelve has too few effective points."""
KNOWN = 0.5
"""Half of an interval over its middle, up to which a number is stated at all."""
AT_THE_END = 0.5
"""Density of a marginal at an end of its range over its greatest, from which that end is the
range's and not the data's."""
BINS = 10
MOST = 2
"""Bodies of a row whose sizes are asked for."""
ONE_ROW = (
    "one row cannot tell a narrowing from a stiff wall: scan a second row over a healthy stretch "
    "of the same vessel"
)


def with_sizes(
    recording: Recording, presses: tuple[Press, ...], objects: list[ObjectFinding]
) -> list[ObjectFinding]:
    """The objects of a scan with their sizes; in place of a single one that no single body
    explains, the two that do."""
    likelihood = likelihood_of(recording, presses)
    if isinstance(likelihood, str):
        return [replace(thing, sizes=unknown(likelihood)) for thing in objects]
    objects = sorted(objects, key=lambda thing: thing.position_m)
    may = [may_be(thing, likelihood.data.x_m) for thing in objects]
    if not 0 < len(objects) <= MOST or not all(may):
        why = "it has no kind yet" if len(objects) == 1 else "what lies beside it is not known"
        return [replace(thing, sizes=unknown(why)) for thing in objects]
    chosen = likeliest(product(*may), likelihood)
    if chosen is None:
        return [replace(thing, sizes=unknown("the row has no room for it")) for thing in objects]
    posterior = explained(chosen, likelihood)
    if isinstance(posterior, Misfit) and len(objects) == 1:
        pair = likeliest(pairs_with(may[0]), likelihood)
        of_pair = explained(pair, likelihood) if pair else None
        if pair and isinstance(of_pair, Posterior):
            chosen, posterior = pair, of_pair
            name = objects[0].kind
            objects = [
                object_of(n, pair, of_pair, likelihood, recording.face_m2, name) for n in range(2)
            ]
    elif isinstance(posterior, Posterior):
        objects = [
            decided(thing, float(p)) for thing, p in zip(objects, chosen.vessel, strict=True)
        ]
    return [
        replace(thing, sizes=sizes(chosen.bodies, n, posterior, likelihood))
        for n, thing in enumerate(objects)
    ]


def explained(chosen: Likeliest, likelihood: Likelihood) -> "Posterior | Misfit | None":
    """The posterior of a row's bodies; None where it could not be sampled well enough."""
    for seed in range(SAMPLERS):
        posterior = sample(chosen.model, np.random.default_rng(seed))
        freedom = len(likelihood.measured) - len(posterior.best)
        if chdtrc(freedom, posterior.chi2) < WORST:
            return Misfit(posterior.chi2, freedom)
        if posterior.effective >= FEWEST:
            return posterior
    return None


class Misfit(NamedTuple):
    """Bodies in an even block leave more of a row unexplained than `WORST` allows."""

    chi2: float
    freedom: int


def sizes(
    bodies: Bodies, n: int, posterior: Posterior | Misfit | None, likelihood: Likelihood
) -> Sizes:
    """What a row says of its ``n``-th body."""
    if posterior is None:
        return unknown("its posterior could not be sampled well enough to state intervals")
    if isinstance(posterior, Misfit):
        how_many = "no single body" if len(bodies.kinds) == 1 else f"no {len(bodies.kinds)} bodies"
        return unknown(
            f"{how_many} in an even block explain{'s' * (len(bodies.kinds) == 1)} this row (misfit "
            f"{posterior.chi2:.0f} of {posterior.freedom}): more objects, layers, a bone, or "
            "another support"
        )
    half_width_m = likelihood.half_width_m
    diameter = "log_inner" if bodies.kinds[n].beats else "log_diameter"
    depth, across, ratio = (
        posterior.points[:, bodies.column(n, name)] for name in ("depth", diameter, "log_ratio")
    )
    values = {
        "depth": ("depth", half_width_m * depth),
        "diameter": (diameter, half_width_m * np.exp(across)),
        "modulus": ("log_ratio", np.exp(posterior.points[:, 0] + ratio)),
    }
    ranges = bodies.ranges(likelihood.x)
    said: dict[str, Any] = {}
    why = {"stenosis": ONE_ROW} if bodies.kinds[n].beats else {}
    for name, (parameter, value) in values.items():
        at = bodies.column(n, parameter)
        left, middle, right = posterior.quantiles(value)
        from_low, from_high = _ends(posterior, at, *ranges[:, at])
        bounds = (-np.inf if from_low else float(left), np.inf if from_high else float(right))
        unit = "pa" if name == "modulus" else "m"
        if from_low and from_high:
            why[name] = "this row does not tell it"
            continue
        if not (from_low or from_high) and (right - left) / 2 > KNOWN * middle:
            per, shown = (1e3, "mm") if unit == "m" else (1e-3, "kPa")
            why[name] = f"known only from {per * left:.3g} to {per * right:.3g} {shown}"
            continue
        said[f"{name}_ci_{unit}"] = bounds
        if np.isfinite(bounds).all():
            said[f"{name}_{unit}"] = float(middle)
    return Sizes(**said, undecided=why)


def _ends(posterior: Posterior, at: int, low: float, high: float) -> tuple[bool, bool]:
    """Whether the lower and the upper end of a parameter's range are what bounds it."""
    density, _ = np.histogram(
        posterior.points[:, at], bins=BINS, range=(low, high), weights=posterior.weights
    )
    first, *_, last = density > AT_THE_END * density.max()
    return bool(first), bool(last)


def likelihood_of(recording: Recording, presses: tuple[Press, ...]) -> Likelihood | str:
    """Of what a scan of one row measured, or why there is none."""
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
    if len(recording.rows()) > 1:
        return "depth and size are known of single rows: detect each row of a grid alone"
    data = row_data(presses, recording.face_m2)
    if data is None:
        return "the run holds no ramps with places and depths"
    if len(np.unique(data.x_m)) < MIN_NAMED:
        return f"a row of at least {MIN_NAMED} stations is needed"
    likelihood = Likelihood(data, table, scene)
    deepest = table.depths[1]
    if likelihood.sunk[-1] > 1.01 * deepest:
        deepest_mm = 1e3 * deepest * likelihood.half_width_m
        return f"the table of this finger ends at {deepest_mm:.3g} mm: press less deep"
    return likelihood
