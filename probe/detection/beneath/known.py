"""What is known of what was scanned: the block, its finger's touch table, and the priors."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from probe.core.recording import Recording
from probe.detection.beneath.hypotheses import Likelihood
from probe.detection.beneath.row_data import row_data
from probe.detection.priors import DEFAULT, Priors
from probe.detection.pulse.presses import Press
from probe.detection.unequal_depths import usual_depth_m
from sim_backend.scene.scene_file import Scene
from sim_backend.touch.kept import table_for
from sim_backend.touch.table import TouchTable

MIN_PLACES = 3
"""Of which one may be over what lies there, beside the others."""


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
        if len(np.unique(data.x_m)) < MIN_PLACES:
            return f"a row of at least {MIN_PLACES} stations is needed"
        likelihood = Likelihood(data, self.table, self.scene, self.priors)
        deepest = self.table.depths[1]
        if likelihood.sunk[-1] > 1.01 * deepest:
            deepest_mm = 1e3 * deepest * likelihood.half_width_m
            return f"the table of this finger ends at {deepest_mm:.3g} mm: press less deep"
        return likelihood


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
