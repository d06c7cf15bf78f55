"""Scene and wave files: the page about them, odd values, and whatever else may be in one."""

import contextlib
import re
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from paths import ROOT
from pydantic import BaseModel, ValidationError

import palpate
from sim_backend.scene.inclusion import Artery, Stenosis, Tumour
from sim_backend.scene.indenter import Cylinder, Flat, Punch, Skin, Sphere
from sim_backend.scene.odd_values import odd_values
from sim_backend.scene.scene_file import (
    Pulse,
    Scene,
    SceneError,
    Tissue,
    load_scene,
    scene_from_text,
    scene_names,
)
from sim_backend.scene.waves import PA_PER_MMHG, load_wave

DOC = (ROOT / "docs" / "reference" / "scene-file.md").read_text(encoding="utf-8")


def test_the_scene_shown_can_be_read() -> None:
    shown = re.search(r"```toml\n(.*?)```", DOC, re.DOTALL)
    scene = scene_from_text(shown[1], "docs/reference/scene-file.md")
    assert [one.kind for one in scene.inclusion] == ["artery", "tumour"]
    assert scene.indenter.skin is not None


@pytest.mark.parametrize(
    "table", [Artery, Cylinder, Flat, Pulse, Punch, Scene, Skin, Sphere, Stenosis, Tissue, Tumour]
)
def test_no_key_is_missing(table: type[BaseModel]) -> None:
    assert [key for key in table.model_fields if not re.search(rf"\b{key}\b", DOC)] == []


TISA = (resources.files("sim_backend.scene") / "builtin" / "TISA.toml").read_text()


@pytest.mark.parametrize("name", scene_names())
def test_no_scene_that_ships_is_doubted(name: str) -> None:
    assert list(odd_values(palpate.load_scene(name))) == []


@pytest.mark.parametrize("line, slipped, said", [
    ("width_mm = 64.0", "width_mm = 64000", "tissue.width_mm = 64000: 6,400 times more"),
    ("height_mm = 16.83", "height_mm = 16830", "tissue.height_mm = 16830: 1,683 times more"),
    ("modulus_kpa = 50.0", "modulus_kpa = 0.05", "tissue.modulus_kpa = 0.05: 2,000 times less"),
    ("modulus_kpa = 50.0", "modulus_kpa = 5e4", "tissue.modulus_kpa = 50000: 500 times more"),
    ("modulus_kpa = 400.0", "modulus_kpa = 0.4", "inclusion[0].modulus_kpa = 0.4: 250 times"),
    ("modulus_kpa = 4000.0", "modulus_kpa = 4", None),
    ("wall_mm = 0.63", "wall_mm = 0.06", "inclusion[0].wall_mm = 0.06: 167 times less"),
    ("radius_mm = 5.0", "radius_mm = 0.005", "indenter.radius_mm = 0.005: 2,000 times less"),
    ("length_mm = 10.0", "length_mm = 0.01", "indenter.length_mm = 0.01: 1,000 times less"),
    ("diastolic_mmhg = 80.0", "diastolic_mmhg = 0.08", "pulse.diastolic_mmhg = 0.08: 1,250"),
    ("depth_mm = 12.66", "depth_mm = 4.0", None),
])  # fmt: skip
def test_a_slip_of_the_unit_is_doubted_by_name(line: str, slipped: str, said: str | None) -> None:
    assert line in TISA
    doubts = list(odd_values(scene_from_text(TISA.replace(line, slipped, 1).encode(), "TISA")))
    if said is None:
        assert doubts == []
    else:
        (doubt,) = doubts
        assert doubt.startswith(said)
        assert doubt.endswith("is its unit right?")


ANY_FILE = settings(
    deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
VALUES = st.recursive(
    st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=6,
)


@ANY_FILE
@given(st.binary(max_size=300))
def test_no_bytes_break_the_reader_of_scenes(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "any.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=r"any\.toml"):
        load_scene(path)


@ANY_FILE
@given(st.sampled_from(scene_names()), st.data())
def test_any_setting_is_taken_or_refused(name: str, data: st.DataObject) -> None:
    """One key of a good scene replaced: what is taken has a surface, a face and a finite finger."""
    table = load_scene(name).model_dump(exclude_none=True)
    places: list[dict[str, Any]] = [table, table["indenter"], table["pulse"], *table["inclusion"]]
    place = data.draw(st.sampled_from(places))
    place[data.draw(st.sampled_from(list(place)))] = data.draw(VALUES)
    with contextlib.suppress(ValidationError):
        scene = Scene.model_validate(table)
        assert scene.surface_mm > 0
        assert np.isfinite([scene.surface_mm, scene.face_mm2]).all()


@ANY_FILE
@given(
    st.binary(max_size=200)
    | st.builds(
        lambda rows: ("time_s,pressure_mmhg\n" + "\n".join(rows)).encode(),
        st.lists(st.text(alphabet='0123456789.,-+eEnaif "\r\x00', max_size=20), max_size=8),
    )
)
def test_nor_does_a_wave(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "any.csv"
    path.write_bytes(content)
    try:
        wave = load_wave(Pulse(wave=str(path)))
    except SceneError as error:
        assert "any.csv" in str(error)
        return
    assert np.isfinite(wave.pressure_pa(np.linspace(0.0, 2.0, 50))).all()


def test_paper_wave_passes_through_its_knots() -> None:
    wave = load_wave(Pulse(wave="paper"))
    mmhg = wave.pressure_pa(np.array([0.0, 0.10, 0.40, 0.825 - 1e-9])) / PA_PER_MMHG
    assert mmhg == pytest.approx([90, 120, 80, 90], abs=0.02)


def test_brachial_wave_agrees_with_its_series_before_scaling() -> None:
    wave = load_wave(Pulse(wave="brachial"))
    t = np.linspace(0, 0.825, 2000)
    mmhg = wave.pressure_pa(t) / PA_PER_MMHG
    assert mmhg.mean() == pytest.approx(96.6, abs=1.5)  # the published mean
    assert np.argmax(mmhg) < 0.4 * len(t)  # systole comes first


@pytest.mark.parametrize("name", ["paper", "brachial"])
def test_waves_span_diastole_to_systole_and_repeat_with_the_heart(name: str) -> None:
    wave = load_wave(Pulse(wave=name, rate_bpm=60, systolic_mmhg=150, diastolic_mmhg=70))
    t = np.linspace(0, 1, 5000)
    mmhg = wave.pressure_pa(t) / PA_PER_MMHG
    assert (mmhg.min(), mmhg.max()) == pytest.approx((70, 150), abs=0.05)
    assert wave.pressure_pa(t + 3) == pytest.approx(wave.pressure_pa(t), rel=1e-9)


def test_csv_wave_is_scaled(tmp_path: Path) -> None:
    (tmp_path / "beat.csv").write_text("time_s,pressure_mmhg\n0,1\n0.2,3\n0.5,2\n1,1\n")
    wave = load_wave(Pulse(wave="beat.csv", rate_bpm=120), tmp_path)
    assert wave.period_s == 0.5
    mmhg = wave.pressure_pa(np.array([0.0, 0.1, 0.25])) / PA_PER_MMHG
    assert mmhg == pytest.approx([80, 120, 100], abs=0.1)


@pytest.mark.parametrize("text, said", [
    ("time_s,p\n0,1\n", "pressure_mmhg"),
    ("time_s,pressure_mmhg\n0,1\n0,2\n1,3\n2,1\n", "line 3"),
    ("time_s,pressure_mmhg\n0,1\n1,x\n", "not a table of numbers"),
    ("time_s,pressure_mmhg\n0,1\n1,1\n2,1\n3,1\n", "never changes"),
    ("time_s,pressure_mmhg\n0,1\n1,nan\n2,1\n3,1\n", "not finite"),
])  # fmt: skip
def test_wrong_waves_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "w.csv").write_text(text)
    with pytest.raises(SceneError, match=said):
        load_wave(Pulse(wave="w.csv"), tmp_path)
