"""Keys are written into a rig file by its lines: nothing else in it changes."""

import pytest

from probe.config.rig import RigError
from probe.config.rig_text import with_keys

TEXT = """\
# the lab's rig
[stage]
driver = "ur"   # it's the old one
yaw_deg = 3.0   # taught in May, not so well

[[sensor]]
driver = "ur"
yaw_deg = 1.0
"""


def test_keys_are_replaced_or_added_and_the_rest_is_kept() -> None:
    made = with_keys(TEXT, "stage", {"yaw_deg": 12.5, "origin_mm": (1.0, -2.25, 3.0)})
    assert (
        made
        == """\
# the lab's rig
[stage]
driver = "ur"   # it's the old one
yaw_deg = 12.5   # taught in May, not so well
origin_mm = [1.0, -2.25, 3.0]

[[sensor]]
driver = "ur"
yaw_deg = 1.0
"""
    )


@pytest.mark.parametrize(
    "text",
    ["stage = { driver = 'ur' }\n", "[stage]\norigin_mm = [\n  1.0,\n  2.0,\n  3.0,\n]\n"],
    ids=["no table", "more than one line"],
)
def test_what_lines_cannot_change_is_left_to_the_person(text: str) -> None:
    with pytest.raises(RigError, match="by hand"):
        with_keys(text, "stage", {"origin_mm": (1.0, 2.0, 3.0)})
