"""Scene and wave files come from others: whatever is in one, it is used or refused."""

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from sim_backend.scene.scene_file import Pulse, Scene, SceneError, load_scene, scene_names
from sim_backend.scene.waves import load_wave

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
