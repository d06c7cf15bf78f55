"""Values as notebooks have them: of numpy, of pandas, of one's own arrays, right and wrong."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_presses import recording, row
from pydantic import ValidationError

import palpate

RIG = palpate.Rig.model_validate({"scan": {"start_mm": 28.0, "stations": 2}})


@pytest.fixture(scope="module")
def scan() -> palpate.Recording:
    return recording(row(np.random.default_rng(2), bump=0.15, pulse_pa=400.0))


def test_a_seed_and_a_label_of_numpy_are_kept_in_the_run(tmp_path: Path, winkler: Any) -> None:
    labels = {"specimen": np.int64(7)}
    done = palpate.scan(RIG, "TIHA", tmp_path, seed=np.int64(3), labels=labels, respond=winkler)
    config = palpate.open_run(done.path).config
    assert (config["seed"], config["labels"]["specimen"]) == (3, "7")
    with pytest.raises(palpate.ConfigError, match=r"seed = 1\.5: must be an integer"):
        palpate.scan(RIG, "TIHA", tmp_path, seed=1.5, respond=winkler)


def test_pressures_are_numbers_of_any_kind_and_no_text() -> None:
    def of(pressures: Any) -> list[float]:
        pressed = palpate.press("TIHA", 32, 0.5, pressures, model="small", accuracy_pct=20)
        return [state.pressure_mmhg for state in pressed.states]

    assert of(np.int64(80)) == of(np.array([80])) == of(80.0) == [80.0]
    with pytest.raises(palpate.SceneError, match="pressures_mmhg = '80': must be a number"):
        of("80")


@pytest.mark.parametrize("model", ["small", "finite"])
def test_a_press_goes_to_another_process(model: str) -> None:
    pressed = palpate.press("TI", 32, 0.5, model=model, accuracy_pct=20)
    again = pickle.loads(pickle.dumps(pressed))
    assert again.states[0].force_n == pressed.states[0].force_n


def test_a_changed_copy_is_checked_as_a_file_is() -> None:
    scene = palpate.load_scene("TIHA")
    tissue = scene.tissue
    softer = scene.model_copy(update={"tissue": tissue.model_copy(update={"modulus_kpa": 30.0})})
    assert softer.tissue.modulus_kpa == 30.0
    for wrong in ({"modulus_kpa": -30.0}, {"modulus_kpa": "30"}, {"modulus_pka": 30.0}):
        with pytest.raises(ValidationError):
            tissue.model_copy(update=wrong)
    far = scene.inclusion[0].model_copy(update={"x_mm": 500.0})
    with pytest.raises(ValidationError, match="breaks a side"):
        scene.model_copy(update={"inclusion": (far,)})


@pytest.mark.parametrize("name", ["signal_pa", "saturated", "depth_m", "reference"])
def test_arrays_that_do_not_belong_together_are_refused(name: str, scan: palpate.Recording) -> None:
    station = scan.stations[0]
    wrong: dict[str, Any] = {name: np.zeros((3, 1)) if name != "reference" else np.zeros(5)}
    with pytest.raises(ValueError, match=rf"station 1: {name} has the shape .* is needed"):
        replace(station, **wrong)
    with pytest.raises(ValueError, match="signal_pa has the shape"):
        replace(station, signal_pa=station.signal_pa[:, 0])


def test_times_in_milliseconds_are_asked_about(scan: palpate.Recording) -> None:
    slow = [
        replace(s, time_s=1e3 * s.time_s, indent_s=np.nan, hold_s=np.nan, retract_s=np.nan)
        for s in scan.stations
    ]
    found = palpate.detect(replace(scan, stations=tuple(slow)))
    assert found.finding == "undecided"
    assert "Are its times in seconds?" in str(found)


@pytest.mark.parametrize("make, said", [
    (lambda: palpate.Rig(scan={"stations": -1}), r"^scan\.stations = -1: must be greater"),
    (lambda: palpate.Rig(scan={"pitch": 4}), r"^scan\.pitch = 4: .*did you mean pitch_mm"),
    (lambda: palpate.Rig(face=3), r"^face = 3: unknown key"),
    (lambda: palpate.Scene(name="bare"), r"^without a \[tissue\] table"),
    (lambda: palpate.Scene(name="thin", tissue={"width_mm": -1}), r"^tissue\.width_mm = -1"),
])  # fmt: skip
def test_rigs_and_scenes_made_in_python_are_refused_in_a_files_words(make: Any, said: str) -> None:
    with pytest.raises((palpate.RigError, palpate.SceneError), match=said) as refused:
        make()
    assert "pydantic" not in str(refused.value)
