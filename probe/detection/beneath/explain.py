"""How deep, how large and how stiff a named object is, from a whole row: ramps, levels, pulses."""

from typing import Any

import numpy as np
from scipy.special import chdtrc

from drivers.core.arrays import Array
from probe.core.recording import Recording
from probe.detection.beneath.hypotheses import HYPOTHESES, Likelihood, names_of
from probe.detection.beneath.posterior import Posterior, most_likely, sample
from probe.detection.beneath.row_data import row_data
from probe.detection.beneath.sizes import Sizes, unknown
from probe.detection.pulse.presses import Press
from probe.detection.repeats import MIN_NAMED
from sim_backend.scene.scene_file import Scene
from sim_backend.touch.kept import table_for
from sim_backend.touch.kinds import Kind
from sim_backend.touch.table import TouchTable

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
ONE_ROW = (
    "one row cannot tell a narrowing from a stiff wall: scan a second row over a healthy stretch "
    "of the same vessel"
)


def sizes(recording: Recording, presses: tuple[Press, ...], kind: str) -> Sizes:
    """Of the only object of a scan of one row, named ``kind``."""
    found = table_of(recording)
    if isinstance(found, str):
        return unknown(found)
    if kind not in HYPOTHESES:
        return unknown("it has no kind yet")
    if len(recording.rows()) > 1:
        return unknown("depth and size are known of single rows: detect each row of a grid alone")
    data = row_data(presses, recording.face_m2)
    if data is None:
        return unknown("the run holds no ramps with places and depths")
    if len(np.unique(data.x_m)) < MIN_NAMED:
        return unknown(f"a row of at least {MIN_NAMED} stations is needed")
    table, half_width_m, length_m, middle_m = found
    if data.sunk_m[-1] > 1.01 * table.sunk[-1] * half_width_m:
        deepest_mm = 1e3 * table.sunk[-1] * half_width_m
        return unknown(f"the table of this finger ends at {deepest_mm:.3g} mm: press less deep")
    return stated(kind, Likelihood(data, table, half_width_m, length_m, middle_m))


def stated(kind: str, likelihood: Likelihood) -> Sizes:
    """What a row says of the one body of this kind beneath it."""
    body = HYPOTHESES[kind]
    mode = most_likely(likelihood.model(body))
    model = likelihood.model(body, mode)
    freedom = len(likelihood.measured) - len(mode)
    for seed in range(SAMPLERS):
        posterior = sample(model, np.random.default_rng(seed))
        if chdtrc(freedom, posterior.chi2) < WORST:
            return unknown(
                f"no single {kind} in an even block explains this row (misfit "
                f"{posterior.chi2:.0f} of {freedom}): several objects, layers, a bone, or another "
                "support"
            )
        if posterior.effective >= FEWEST:
            return _intervals(body, posterior, model.low, model.high, likelihood.half_width_m)
    return unknown("its posterior could not be sampled well enough to state intervals")


def _intervals(
    body: Kind, posterior: Posterior, low: Array, high: Array, half_width_m: float
) -> Sizes:
    names = names_of(body)
    column = {name: posterior.points[:, k] for k, name in enumerate(names)}
    diameter = "log_diameter" if "log_diameter" in column else "log_inner"
    values = {
        "depth": ("depth", half_width_m * column["depth"]),
        "diameter": (diameter, half_width_m * np.exp(column[diameter])),
        "modulus": ("log_ratio", np.exp(column["log_modulus"] + column["log_ratio"])),
    }
    said: dict[str, Any] = {}
    why = {"stenosis": ONE_ROW} if diameter == "log_inner" else {}
    for name, (parameter, value) in values.items():
        at = names.index(parameter)
        left, middle, right = posterior.quantiles(value)
        from_low, from_high = _ends(posterior, at, low[at], high[at])
        bounds = (-np.inf if from_low else float(left), np.inf if from_high else float(right))
        unit = "pa" if name == "modulus" else "m"
        if from_low and from_high:
            why[name] = "this row does not tell it"
            continue
        if not (from_low or from_high) and (right - left) / 2 > KNOWN * middle:
            why[name] = f"known only from {left:.3g} to {right:.3g} {unit}"
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


def table_of(recording: Recording) -> tuple[TouchTable, float, float, float] | str:
    """The table of a recording's finger and block, the finger's half width and length [m] and
    where the block's middle is; or why there is none."""
    if recording.block is None:
        return (
            "finger and block are not known: give a scene with them as [scene] in the rig file, or "
            "to `palpate import` as --scene"
        )
    if not recording.block.get("tissue"):
        return "depth and size are known of what lies in a block of tissue"
    block = Scene.model_validate({"name": "block", **recording.block})
    table = table_for(block)
    if table is None or block.tissue is None:
        return f'there is no table for this finger over this block of plane = "{block.plane}"'
    return (
        table, 0.5e-3 * block.indenter.width_mm_projected, 1e-3 * block.indenter.length_mm,
        0.5e-3 * block.tissue.width_mm,
    )  # fmt: skip
