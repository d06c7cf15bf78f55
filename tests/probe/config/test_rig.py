import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_scene import changed
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from paths import ROOT
from pydantic import ValidationError

from drivers import ConfigError, SimulatedClock
from probe.config.devices import connect
from probe.config.load_rig import load_rig
from probe.config.rig import Rig, RigError, Safety, default_rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.config.snapshot import run_config
from sim_backend.scene.scene_file import load_scene

VIRTUAL = '[stage]\ndriver = "virtual"\n[[sensor]]\ndriver = "virtual"\n'
SCENE = '[scene]\nname = "TI"\n'


def write(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_example_is_the_default_rig() -> None:
    example, usual = load_rig(ROOT / "rigs" / "virtual.toml"), default_rig()
    plan = plan_for(example)
    assert (example.scan, plan.places) == (usual.scan, plan_for(usual).places)
    assert limits_for(example, plan) == limits_for(usual, plan_for(usual))
    assert example.scan.indentation_mm / example.scan.ramp_s == 2.5


@pytest.mark.parametrize(("name", "found"), [("mine.toml", "{}/mine.toml"), ("TI", "TI")])
def test_a_scene_s_file_lies_beside_the_rig_s(name: str, found: str, tmp_path: Path) -> None:
    rig = load_rig(write(tmp_path, f'{VIRTUAL}[scene]\nname = "{name}"\n'))
    assert rig.scene.name == found.format(tmp_path)


@pytest.mark.parametrize("width_mm, first_mm, last_mm, stations", [
    (64.0, 4.0, 60.0, 15), (100.0, 4.0, 96.0, 24), (50.0, 5.0, 45.0, 11), (7.0, 3.5, 3.5, 1),
])  # fmt: skip
def test_the_default_row_reaches_over_the_whole_block(
    width_mm: float, first_mm: float, last_mm: float, stations: int
) -> None:
    rig = default_rig(changed("TI", tissue={"width_mm": width_mm}))
    plan = plan_for(rig)
    limits_for(rig, plan)  # all within the workspace
    ends_mm = [1e3 * plan.places[n].x_m for n in (0, -1)]
    assert (len(plan.places), ends_mm) == (stations, pytest.approx([first_mm, last_mm]))


def test_out_of_tissue_there_is_one_station_over_the_artery() -> None:
    (place,) = plan_for(default_rig(load_scene("HAOT"))).places
    assert place.x_m == pytest.approx(0.032)


@pytest.mark.parametrize("text, said", [
    ("[scan]\nstations = 30\n", "station 18 .* x = 72 mm"),
    ("[scan]\nstations = 0\n", "scan.stations = 0: must be greater than or equal to 1"),
    ("[scan]\nramp_s = -1\n", "scan.ramp_s = -1"),
    ("[scan]\nramp_s = 0.01\n", "250 mm/s: must not exceed safety.max_speed_mm_s = 25"),
    ("[scan]\nindent_mm = 2\n", "scan.indent_mm = 2: unknown key .did you mean indentation_mm"),
    ("[scan]\nhold_s = nan\n", "scan.hold_s = nan"),
    ("[scan]\ntouch_n = 9\n", "scan.touch_n = 9: must be below safety.max_force_n = 5"),
    ("[scan]\nforce_n = 4.5\n", "force_n = 4.5: must be at most 4, 0.8 of safety.max_force_n = 5"),
    ("[scan]\nsteps_n = [1, 4.5]\n", "steps_n = 4.5: must be at most 4, 0.8 of"),
    ("[scan]\nsteps_n = [1, 1.05]\n", r"steps_n = \[1.0, 1.05\]: each must be 1.1 times"),
    ("[scan]\nsteps_mm = [1, 3]\n", "steps_mm = .*: must end at most at scan.indentation_mm = 2.5"),
    ("[scan]\nsteps_mm = [1, 1, 2]\n", r"scan.steps_mm = \[1.0, 1.0, 2.0\]: must ascend"),
    ("[scan]\nforce_n = 1\nsteps_n = [1, 2]\n", "steps_n: a press ends by one of scan.force_n, "),
    ("[safety]\nmax_depth_mm = 1\n", "safety.max_depth_mm = 1: the scan goes 2.5 mm"),
    ("[safety.workspace_mm]\nx = [5, 1]\n", r"x = \[5, 1\]: the first must be the smaller"),
    (
        "[scan]\nstart_mm = 0\nsurface_mm = [[0,0,0],[60,0,34.64],[0,9,0],[60,9,34.64]]\n"
        "[safety]\nmax_depth_mm = 2.6\n",
        "safety.max_depth_mm = 2.6: the scan goes 2.88",  # 2.5 mm along the normal, at 30 deg
    ),
    ("[safety]\nretract_mm = 0.4\n", "safety.retract_mm = 0.4: must be .* 0.5"),
    ("[safety]\nworkspace_mm.z = [-4, 2.2]\n", "workspace_mm.z ends at 2.2 mm: .*to 2.5 mm"),
    ("[scan]\nindentation_mm = 1e-320\n", "scan.indentation_mm = 1e-320: must be greater"),
    (SCENE + "surface_mm = 1e308\n", r"scene.surface_mm = 1e\+308: must be less than"),
    (SCENE + "surface_mm = [[0,0,0],[1,0,0],[0,1,1e308]]\n", r"scene.surface_mm.2.2 = 1e\+308"),
    ('[calibration]\nforce = "none.json"\n', "calibration.force = .*none.json"),
    ('[calibration]\nforze = "none.json"\n', "calibration.forze: 'forze' is no kind .*; these"),
    ('[calibration]\nforce = ""\n', "calibration.force = '': name its file, or leave the"),
    ('[calibration]\nforce = "."\n', "calibration.force = .*: a folder; name the file in it"),
    ("[scan\n", "not TOML"),
    ("[scan]\nstations = 100000\nrepeats = 1000\n", "make 1e.08 presses; at most 100000"),
    ("[scan]\nsurface_mm = [[0,0,0],[1,1,0],[2,2,0]]\n", "must not lie on one line"),
    ('[[sensor]]\ndriver = "virtual"\nrate_hz = 0\n', r"sensor\[1\].rate_hz = 0: must be"),
    ('[[sensor]]\ndriver = "virtual"\nrate_hz = nan\n', r"sensor\[1\].rate_hz = nan"),
    ('[[sensor]]\ndriver = "virtual"\nrate_hz = "5 Hz"\n', r"sensor\[1\].rate_hz = '5 Hz': must"),
    ('[[sensor]]\ndriver = "virtual"\nrate_hz = [5]\n', r"sensor\[1\].rate_hz = \[5\]: must"),
    ('[[sensor]]\ndriver = "virtual"\nnoise_mn = "5"\n', r"sensor\[1\].noise_mn = '5': must"),
    ('[[sensor]]\ndriver = "virtual"\nnoise_mn = inf\n', r"noise_mn = inf: must be from 0"),
])  # fmt: skip
def test_wrong_rigs_name_file_key_and_value(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(RigError, match=said) as caught:
        load_rig(write(tmp_path, VIRTUAL + text))
    assert str(caught.value).startswith(str(tmp_path))


def test_limits_need_a_plan() -> None:
    with pytest.raises(TypeError, match="plan_for"):
        limits_for(Rig(), None)


@pytest.mark.parametrize("text, said", [
    ("scan = 3", "scan = 3: must be a table"),
    ("scan.start_mm = 'x'", "scan.start_mm = 'x': must be a number"),
    ("scan.start_mm = []", "scan.start_mm has 0 values, and needs more"),
    ("scan.start_mm = [1, 'x']", "scan.start_mm.1 = 'x': must be a number"),
    ("scan.start_mm = [1, 2, 3]", "scan.start_mm = [1, 2, 3]: must have at most 2 entries"),
    ("scan.stations = [5, 0]", "scan.stations.1 = 0: must be greater than or equal to 1"),
    (
        "scan.surface_mm = [1]",
        "scan.surface_mm.0 = 1: must be a list, in [ ]\n"
        "scan.surface_mm = [1]: must have 3 or more entries",
    ),
    ("safety.workspace_mm.x = 3", "safety.workspace_mm.x = 3: must be a list, in [ ]"),
    ("scene.name = 3", "scene.name = 3: must be text, in quotes"),
    ("sensor = []", "sensor = []: must have 1 or more entries"),
    ("[safety.workspace_mm.x]", "safety.workspace_mm.x: must be a list, in [ ]"),
    ("[sensor]", "sensor: is a list of tables: write [[sensor]], in two brackets"),
])  # fmt: skip
def test_a_value_of_another_kind_is_refused_in_the_words_of_the_file(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(RigError) as caught:
        load_rig(write(tmp_path, text))
    assert str(caught.value).replace(f"{tmp_path / 'rig.toml'}: ", "") == said


@pytest.mark.parametrize("text, said", [
    (VIRTUAL.replace("virtual", "warp", 1) + SCENE, "stage.driver = 'warp': .*known: .*ur"),
    (VIRTUAL + "rate_hz = 'fast'\n" + SCENE, "sensor.0..rate_hz = 'fast'"),
    (VIRTUAL + "rate_hz = 0\n" + SCENE, "sensor.0..rate_hz = 0: must be above 0"),
    (VIRTUAL + "rate_hz = 1e9\n" + SCENE, "sensor.0..rate_hz = 1e.09: must be at most 100000"),
    ("[[sensor]]\ndriver = 'netft'\nhost = 'x'\nrate_hz = 1e300\n" + SCENE,
     "sensor.0..rate_hz = 1e.300: must be at most 100000"),
    (VIRTUAL + "colour = 1\n" + SCENE, "colour = 1: unknown key; known here: .*rate_hz"),
    (VIRTUAL + "rate = 1\n" + SCENE, "sensor.0..rate = 1: .*did you mean rate_hz"),
    ("[[sensor]]\ndriver = 'modbus'\nport = 'x'\n[[sensor.register]]\nname = 'f'\nadress = 1\n"
     + SCENE, r"adress = 1: .*did you mean address..; known here: address, full_scale, name, r"
              r"[^@]*$(?<!entries)"),
    (VIRTUAL, "scene.name is missing"),
    (VIRTUAL + "name = 'stage'\n" + SCENE, "name = 'stage': taken"),
    (VIRTUAL + "[[sensor]]\ndriver = 'virtual'\n" + SCENE, r"sensor\[1\].name = 'force'"),
    (VIRTUAL + SCENE + "[scan]\nindentation_mm = 17\nramp_s = 9\n[safety.workspace_mm]\n"
     "z = [-20, 20]\n", "only 16.83 mm thick"),
])  # fmt: skip
def test_wrong_devices_name_key_and_value(
    tmp_path: Path, winkler: Any, text: str, said: str
) -> None:
    with pytest.raises(RigError, match=said):
        connect(load_rig(write(tmp_path, text)), SimulatedClock(), respond=winkler)


OTHER_SAFETY: dict[str, Any] = {
    "max_force_n": 4.0, "max_torque_nm": 0.2, "max_depth_mm": 3.5, "max_speed_mm_s": 30.0,
    "workspace_mm": {"y": [-6.0, 6.0]}, "retract_mm": 3.0, "silence_s": 0.3, "late_s": 0.1,
    "hardest_n_mm": 5.0, "contact_within_mm": 1.0, "engine_s": 3.0, "same_readings": 50,
}  # fmt: skip


@pytest.mark.parametrize("key", Safety.model_fields)
def test_no_key_of_the_safety_table_is_left_out(key: str) -> None:
    usual, other = Rig(), Rig.model_validate({"safety": {key: OTHER_SAFETY[key]}})
    plan, changed = plan_for(usual), plan_for(other)
    assert (limits_for(usual, plan), plan.travel_z_m) != (
        limits_for(other, changed),
        changed.travel_z_m,
    )


@pytest.mark.parametrize("depth_mm", [0.9, 1.3, 1.8, 2.5])
def test_a_press_may_be_as_deep_as_is_allowed(depth_mm: float) -> None:
    """0.9 mm in metres and back is more than 0.9 mm."""
    rig = Rig.model_validate({
        "scan": {"indentation_mm": depth_mm}, "safety": {"max_depth_mm": depth_mm},
    })  # fmt: skip
    plan = plan_for(rig)
    assert limits_for(rig, plan).max_depth_m >= plan.deepest_below_m


def test_a_measured_surface_is_a_plane_through_three_points() -> None:
    rig = Rig.model_validate({"scan": {"surface_mm": [[0, 0, 0], [60, 0, 3], [0, 5, 0]]}})
    assert plan_for(rig).surface(0.030, 0.002) == pytest.approx(1.5e-3, abs=1e-6)


def test_the_configuration_of_a_run_is_complete() -> None:
    scene, rig = load_scene("TIHA"), default_rig()
    config = run_config(rig, scene, plan_for(rig), seed=7)
    assert config["face_mm2"] == 100.0
    assert config["seed"] == 7
    assert len(config["plan"]["stations"]) == 15
    assert config["versions"]["palpate"]
    assert config["plan"]["incline_deg"] == 15 * [0.0]


def test_a_row_that_says_only_where_it_starts_along_x_lies_at_y_zero() -> None:
    rig = Rig.model_validate({"scan": {"start_mm": 8.0, "pitch_mm": 4.0, "stations": 3}})
    places = [(place.x_m, place.y_m) for place in plan_for(rig).places]
    assert np.array(places) == pytest.approx(np.array([[8e-3, 0], [12e-3, 0], [16e-3, 0]]))


def test_a_run_keeps_how_far_its_surface_leans() -> None:
    """Depth is along the normal. 3 by 4 in 12 is 5 in 12."""
    slope = [[0.0, 0.0, 0.0], [12.0, 0.0, 3.0], [0.0, 12.0, 4.0]]
    rig = Rig.model_validate({"scan": {"stations": 2, "surface_mm": slope}})
    kept = run_config(rig, None, plan_for(rig), seed=0)["plan"]
    assert kept["incline_deg"] == pytest.approx(2 * [math.degrees(math.atan2(5, 12))])
    heights_mm = [0.25 * x + y / 3 for _, x, y in kept["stations"]]
    assert kept["surface_mm"] == pytest.approx(heights_mm)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200))
def test_any_file_is_a_rig_or_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "any.toml"
    path.write_bytes(content)
    try:
        rig = load_rig(path)
    except RigError as refused:
        assert str(path) in str(refused)
    else:
        assert rig == Rig.model_validate(tomllib.loads(content.decode("utf-8-sig")))


VALUES = st.one_of(
    st.floats(), st.integers(-(2**40), 2**40), st.text(max_size=5), st.booleans(),
    st.lists(st.floats(-1e6, 1e6), max_size=4),
)  # fmt: skip


@settings(deadline=None)
@given(
    st.sampled_from(["scan", "safety", "scene", "stage", "calibration"]),
    st.dictionaries(
        st.sampled_from([*Rig().scan.model_dump(), *Rig().safety.model_dump()]), VALUES
    ),
)
def test_any_setting_is_taken_or_refused_with_a_reason(table: str, keys: dict[str, Any]) -> None:
    try:
        rig = Rig.model_validate({table: keys})
        plan = plan_for(rig)
        limits = limits_for(rig, plan)
    except ValidationError as refused:
        assert {error["loc"][0] for error in refused.errors() if error["loc"]} <= {table}
        assert all(error["msg"] for error in refused.errors())
    except (RigError, ConfigError) as refused:
        assert re.search(r"(scan|safety|scene|stage|calibration)\.\w+|\w+ = ", str(refused))
    else:
        assert max(plan.travel_m_s, plan.approach_m_s) <= limits.max_speed_m_s
        assert 0 < plan.indentation_m <= limits.max_depth_m
        assert limits.max_force_n > 0
