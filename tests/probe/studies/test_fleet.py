"""Fleet files: what is drawn is possible, labelled and felt."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from probe.studies.fleet import KINDS, drawn, fleet, force_n
from probe.studies.vary import applied
from sim_backend import load_scene


@pytest.mark.parametrize("kind", KINDS)
def test_all_that_is_drawn_is_possible(kind: str) -> None:
    scene = load_scene(KINDS[kind])
    for point in drawn(kind, 40, 3):
        applied(scene, point)  # raises where it is not
    assert drawn(kind, 5, 3) == drawn(kind, 5, 3) != drawn(kind, 5, 4)


def test_kinds_are_drawn_from_seeds_of_their_own() -> None:
    lumps, vessels = ([p["tissue.height_mm"] for p in drawn(kind, 5, 0)]
                      for kind in ("tumour", "artery"))  # fmt: skip
    assert lumps != vessels


def test_a_beat_goes_through_diastole_middle_and_systole() -> None:
    rows = pd.DataFrame({"force_n": [1.0, 2.0], "pulse_n": [0.1, 0.0], "half_pulse_n": [0.04, 0.0]})
    force = force_n(rows, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(force, [[1.0, 1.04, 1.1], [2.0, 2.0, 2.0]])


@pytest.mark.slow
def test_a_fleet_has_every_kind_and_what_was_drawn(tmp_path: Path) -> None:
    out = tmp_path / "fleet.parquet"
    table = fleet(1, out, seed=1, x_mm=(16.0, 32.0), workers=1)
    pd.testing.assert_frame_equal(pd.read_parquet(out), table)
    assert table["kind"].tolist() == [kind for kind in KINDS for _ in range(2)]
    assert (table["reason"] == "").all()
    beats = table["kind"].str.contains("artery")
    assert (table["pulse_n"][beats] != 0).all()
    assert (table["pulse_n"][~beats] == 0).all()
    assert table["inclusion.0.depth_mm"].notna().tolist() == [k != "nothing" for k in table["kind"]]
