"""The scene that a scan's tissue most likely is: its twin, to be pressed in place of it."""

import json
from dataclasses import replace
from os import PathLike

import numpy as np

from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.core.recording import Recording
from probe.detection.beneath.posterior import laplace
from probe.detection.beneath.row_evidence import row_evidence
from probe.detection.finding import HEALTHY
from probe.detection.priors import Priors, priors_of
from probe.detection.pulse.presses import presses_of
from probe.storage.run import recording_of
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.touch.bodies import Units

OPEN = 1e-3
"""A narrowing of less is none."""


def twin(
    source: Recording | str | PathLike[str],
    *,
    priors: Priors | str | PathLike[str] | None = None,
) -> Scene:
    """The likeliest scene of a row of presses.

    Its block, finger and support are those that the run was of; the tissue's modulus, and place,
    depth, size and stiffness of what lies in it, are the likeliest ones together. A vessel that is
    called healthy is open. `detect` says how well each is known: another scene may be nearly as
    likely.

    Parameters
    ----------
    source
        A recording, a run, or a run file, of one row.
    priors
        As `detect` takes them.

    Returns
    -------
    Scene
        To be pressed, scanned and written like any other.

    Raises
    ------
    SceneError
        The scan does not say what lies there; the text says why.
    RunFileError
        The file cannot be read, or is no run.
    ConfigError
        The file of priors names the key that is wrong.

    Examples
    --------
    >>> import palpate
    >>> vessel = palpate.twin("TIHA.run").inclusion[0]
    >>> vessel.kind, vessel.stenosis
    ('artery', None)
    """
    recording, believed = recording_of(source), priors_of(priors)
    if len(rows := recording.rows()) > 1:
        raise SceneError("the scan has no twin: it is of several rows; a twin is of one")
    presses = presses_of(recording, DEFAULT_FALSE_ALARM / 2)
    said = row_evidence(recording, [presses[i] for i in rows[0]] if rows else [], believed)
    if isinstance(said, str):
        raise SceneError(f"the scan has no twin: {said}")
    bodies, row, likelihood = said.bodies, said.hypotheses, said.likelihood
    if not bodies.kinds:
        raise SceneError("the scan has no twin: nothing lies there")
    best = row.posteriors[bodies].best
    model = likelihood.model(bodies, best)
    high, open_at = model.high.copy(), []
    for n, (thing, kind) in enumerate(zip(said.objects, bodies.kinds, strict=True)):
        if kind.beats and thing.kind == HEALTHY:
            open_at.append(bodies.column(n, "narrowing"))
    high[open_at] = OPEN
    best = laplace(replace(model, high=high)).best
    best[open_at] = 0.0
    block = likelihood.scene
    tissue = block.tissue
    assert tissue is not None  # a known block has one
    tissue = tissue.model_copy(update={"modulus_kpa": 1e-3 * float(np.exp(best[0]))})
    units = Units(block.model_copy(update={"name": "twin", "tissue": tissue}))
    each = [bodies.of(best[None], n, likelihood.block)[0] for n in range(len(bodies.kinds))]
    scene = units.scene(*zip(bodies.kinds, each, strict=True))
    return _rounded(scene.model_copy(update={"tissue": tissue}))


def _rounded(scene: Scene) -> Scene:
    """To digits that a person reads, which say less than what is known."""
    text = scene.model_dump_json(exclude_none=True)
    return Scene.model_validate(json.loads(text, parse_float=lambda t: float(f"{float(t):.5g}")))
