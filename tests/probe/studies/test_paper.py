"""The paper's statements, judged."""

import numpy as np
import pandas as pd
import pytest

from probe.studies.paper import (
    READINGS,
    Task,
    _pulse_of_tisa,
    _trend,
    answer,
    changed,
    tasks,
)
from probe.studies.paper_values import FIGURES, LEVELS_MMHG, TIMES_S
from sim_backend import load_scene
from sim_backend.scene.waves import PA_PER_MMHG, load_wave


def trend(pulses: list[float]) -> str:
    at = (*FIGURES["7"][1][:2], 2.0, FIGURES["7"][1][-1])
    rows = [
        {"figure": "7", "model": "finite", "plane": "stress", "reason": "", "indentation_mm": d,
         "contact_pa_120": 1000 + pulse, "contact_pa_80": 1000.0}
        for d, pulse in zip(at, pulses, strict=True)
    ]  # fmt: skip
    return _trend(pd.DataFrame(rows), "7", "indentation").verdict


def test_trends_hold_or_not_or_up_to_where() -> None:
    assert trend([1, 2, 3, 4]) == "holds"
    assert trend([1, 2, 3, 2]) == "holds up to 2"
    assert trend([4, 3, 2, 1]) == "does not hold"


def test_every_figure_has_its_presses() -> None:
    assert set(tasks()) == {"3", "4", "5", "6", "7", "8", "9", "readings"}
    for changes, _ in READINGS.values():
        changed(load_scene("TISA"), changes)


def test_levels_are_the_waves_at_the_papers_times() -> None:
    wave = load_wave(load_scene("TIHA").pulse)
    mmhg = wave.pressure_pa(np.array(TIMES_S) - 1.0) / PA_PER_MMHG
    np.testing.assert_allclose(mmhg, LEVELS_MMHG, atol=1e-3)


def pulse_of_tisa(pulses: list[float]) -> str:
    rows = [
        {"figure": "readings", "reading": str(n), "model": "finite", "reason": "",
         "pulse_pa": pulse, "von_mises_pulse_pa": pulse}
        for n, pulse in enumerate(pulses)
    ]  # fmt: skip
    return _pulse_of_tisa(pd.DataFrame(rows)).verdict


def test_the_papers_pulse_holds_only_where_readings_agree() -> None:
    assert pulse_of_tisa([22.0, 23.0]) == "holds"
    assert pulse_of_tisa([22.0, 44.0]) == "holds in part"
    assert pulse_of_tisa([10.0, 44.0]) == "does not hold"


def test_a_press_is_a_row() -> None:
    row = answer(Task("TIT", (), 32.0, 1.0, "small", (0.0,)))
    assert row["contact_pa_0"] > 0
    assert row["reason"] == ""


def test_an_impossible_press_is_a_row_with_its_reason() -> None:
    row = answer(Task("TIHA", (("plane", "strain"),), 32.0, 7.0, "small", (0.0,)))
    assert "inside out" in row["reason"]


@pytest.mark.parametrize("scene", ["HAOT", "SAOT"])
def test_lone_arteries_are_among_them(scene: str) -> None:
    assert any(task.scene == scene for task in tasks()["5"])
