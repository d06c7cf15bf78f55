"""Keys that are changed for one scan are checked as the file is; written, nothing else changes."""

import pytest

from probe.config.changed_rig import changed
from probe.config.rig import Rig, RigError, default_rig
from probe.config.rig_text import with_keys
from probe.config.scan_plan import plan_for


@pytest.mark.parametrize("key, text, is_now", [
    ("scan.pitch_mm", "2", lambda rig: rig.scan.pitch_mm == 2.0),
    ("scan.stations", "[3, 2]", lambda rig: len(plan_for(rig).places) == 6),
    ("safety.max_force_n", "2.5", lambda rig: rig.safety.max_force_n == 2.5),
    ("sensor.0.rate_hz", "100", lambda rig: rig.sensor[0].settings["rate_hz"] == 100),
    ("stage.driver", "grbl", lambda rig: rig.stage.driver == "grbl"),
    ("face_mm2", "80", lambda rig: rig.face_mm2 == 80.0),
])  # fmt: skip
def test_any_key_is_changed(key: str, text: str, is_now: object) -> None:
    rig = Rig.model_validate(
        {"scan": {"start_mm": [16, 0], "pitch_mm": [4, 4], "stations": [2, 2]}}
    )
    assert is_now(changed(rig, {key: text}))


@pytest.mark.parametrize("key, text, said", [
    ("scan.pich_mm", "2", "did you mean pitch_mm"),
    ("scan.pitch_mm", "two", "must be a number"),
    ("scan.indentation_mm", "9", "workspace allows"),
    ("skan.pitch_mm", "2", "there is no table 'skan'"),
    ("sensor.7.rate_hz", "2", "none of the entries 0 to 0"),
    ("sensor", "2", "sensor"),
    ("scan.pitch_mm.x", "2", "no table"),
    ("scan.only", "[16]", "the scan has the stations 1 to 15"),
])  # fmt: skip
def test_what_cannot_be_is_refused_by_its_key(key: str, text: str, said: str) -> None:
    with pytest.raises(RigError, match=f"--set {key}".replace(".", r"\.")) as refused:
        changed(default_rig(), {key: text})
    assert said in str(refused.value)


def test_some_of_the_stations_keep_their_numbers_and_places() -> None:
    whole = {place.index: place for place in plan_for(default_rig()).places}
    some = plan_for(changed(default_rig(), {"scan.only": "[5, 7]"})).places
    assert some == (whole[4], whole[6])


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


@pytest.mark.parametrize("text", [
    "stage = { driver = 'ur' }\n", "[stage]\norigin_mm = [\n  1.0,\n  2.0,\n  3.0,\n]\n",
], ids=["no table", "more than one line"])  # fmt: skip
def test_what_lines_cannot_change_is_left_to_the_person(text: str) -> None:
    with pytest.raises(RigError, match="by hand"):
        with_keys(text, "stage", {"origin_mm": (1.0, 2.0, 3.0)})
