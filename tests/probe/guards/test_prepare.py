"""What a scan's preparation notes."""

from pathlib import Path
from typing import Any

import pytest

from probe.checks.dry_run import dry_run
from probe.config.rig import Rig
from sim_backend.scene.scene_file import load_scene


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"stations": [3, 2]}, ["6 stations lie at 3 places"]),
        ({"stations": [3, 2], "pitch_mm": [4, 4]}, []),
        ({"stations": 3, "repeats": 2}, []),
        ({"stations": 3, "pitch_mm": 0}, ["3 stations lie at 1 place"]),
    ],
)
def test_rows_that_lie_on_each_other_are_noted(
    keys: dict[str, Any], said: list[str], tmp_path: Path, winkler: Any
) -> None:
    rig = Rig.model_validate({"scan": keys, "scene": {"name": "TI"}})
    report = dry_run(rig, load_scene("TI"), tmp_path, winkler)
    found = [check.text.partition(":")[0] for check in report.checks if check.name == "note"]
    assert found == said
    assert report.can_scan
