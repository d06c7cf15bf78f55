"""The paper's statements, judged."""

import pandas as pd
import pytest

from probe.studies.paper import READINGS, Task, _trend, answer, changed, tasks
from sim_backend import load_scene


def trend(pulses: list[float]) -> str:
    rows = [
        {"figure": "7", "model": "finite", "plane": "stress", "reason": "", "indentation_mm": d,
         "contact_pa_120": 1000 + pulse, "contact_pa_80": 1000.0}
        for d, pulse in zip((0.5, 1.0, 2.0, 3.0), pulses, strict=True)
    ]  # fmt: skip
    return _trend(pd.DataFrame(rows), "7", "indentation").verdict


def test_trends_hold_or_not_or_up_to_where() -> None:
    assert trend([1, 2, 3, 4]) == "holds"
    assert trend([1, 2, 3, 2]) == "holds up to 2"
    assert trend([4, 3, 2, 1]) == "does not hold"


def test_every_figure_has_its_presses() -> None:
    assert set(tasks()) == {"3", "4", "5", "6", "7", "8", "9", "readings"}
    for changes in READINGS.values():
        changed(load_scene("TISA"), changes)


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
