"""The paper's statements, judged."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from probe.studies.paper import (
    READINGS,
    Statement,
    Task,
    _lone,
    _pulse_of_tisa,
    _trend,
    answer,
    tasks,
)
from probe.studies.paper_values import FIGURES, LEVELS_MMHG, PAPER_PULSE_PA, TIMES_S
from probe.studies.vary import applied
from sim_backend import load_scene
from sim_backend.scene.waves import PA_PER_MMHG, load_wave

ROOT = Path(__file__).parents[3]


def trend(pulses: list[float]) -> Statement:
    at = (*FIGURES["7"][1][:2], 2.0, FIGURES["7"][1][-1])
    rows = [
        {"figure": "7", "model": "finite", "plane": "stress", "reason": "", "indentation_mm": d,
         "contact_pa_120": 1000 + pulse, "contact_pa_80": 1000.0,
         "error_estimate_pct": 10.0 / pulse}
        for d, pulse in zip(at, pulses, strict=True)
    ]  # fmt: skip
    return _trend(pd.DataFrame(rows), "7", "indentation")


def test_trends_hold_or_not_or_up_to_where() -> None:
    assert trend([1, 2, 3, 4]).verdict == "holds"
    assert trend([1, 2, 3, 2]).verdict == "holds up to 2"
    assert trend([4, 3, 2, 1]).verdict == "does not hold"


def test_a_trend_says_its_largest_stated_error() -> None:
    assert "1 to 4 Pa, stated errors up to 10 %" in trend([1, 2, 3, 4]).ours
    assert trend([0.3, 1, 2, 3]).verdict == "holds, stated errors up to 33 %"


def test_every_figure_has_its_presses() -> None:
    assert set(tasks()) == {"3", "4", "5", "6", "7", "8", "9", "readings"}
    assert {task.scene for task in tasks()["5"]} >= {"HAOT", "SAOT"}
    for changes, _ in READINGS.values():
        applied(load_scene("TISA"), dict(changes))


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


def test_the_papers_pulse_is_not_contradicted_where_some_readings_agree() -> None:
    said = pulse_of_tisa([22.0, 44.0])
    assert said == "not contradicted: 1 of 2 readings are within 10 %, over 22 to 44 Pa"
    assert pulse_of_tisa([10.0, 44.0]) == "does not hold"


@pytest.mark.parametrize("pulse_of_haot, stable, verdict", [
    (3.0, True, "holds"), (1.0, True, "does not hold"), (3.0, False, "does not hold"),
])  # fmt: skip
def test_a_lone_vessel_counts_only_where_it_stays(pulse_of_haot, stable, verdict) -> None:
    rows = [
        {"figure": "5", "model": "finite", "scene": "HAOT", "stable": stable,
         "contact_pa_80": 4.0, "contact_pa_120": 4.0 + pulse_of_haot},
        {"figure": "5", "model": "finite", "scene": "SAOT", "stable": True,
         "contact_pa_80": 30.0, "contact_pa_120": 32.0},
    ]  # fmt: skip
    peak, pulse = _lone(pd.DataFrame(rows))
    assert pulse.verdict.startswith(verdict)
    assert peak.verdict.startswith("holds" if stable else "does not hold")
    assert ("does not state" in pulse.verdict) == (verdict == "holds")


def test_the_page_says_of_trends_and_readings_what_the_run_found() -> None:
    data = json.loads((ROOT / "docs" / "figures" / "paper.json").read_text())["data"]
    page = " ".join((ROOT / "docs" / "explanation" / "studies.md").read_text().split())
    trends = {row[0].split(":")[0]: row[1] for row in data["table"] if row[0][5] in FIGURES}
    small = {n: [p for p in ours.split("; ") if p.startswith("small")]
             for n, ours in trends.items()}  # fmt: skip
    assert "Small strain turns tissue inside out where the finger goes deep" in page
    assert all("no answer at 8.5" in part for part in small["Fig. 7"])
    assert "and does not show the trend of Fig. 7" in page
    lost = {n for n, parts in small.items() if any("only up to" in part for part in parts)}
    assert lost == {"Fig. 7"}
    assert "Pulses are proportional to the amplitude of the pressure" in page
    by, usual = data["by_reading_pa"], data["by_reading_pa"]["as documented"]
    for model in ("finite", "small"):
        shares = [by[f"wave: {name} mmHg"][model] / usual[model] for name in ("110/90", "130/70")]
        assert shares == pytest.approx([0.5, 1.5], rel=0.01)
    assert f"The paper gives a pulse of {PAPER_PULSE_PA} Pa" in page


def test_a_press_is_a_row() -> None:
    row = answer(Task("TIT", (), 32.0, 1.0, "small", (0.0,)))
    assert row["contact_pa_0"] > 0
    assert row["reason"] == ""


def test_an_impossible_press_is_a_row_with_its_reason() -> None:
    row = answer(Task("TIHA", (("plane", "strain"),), 32.0, 7.0, "small", (0.0,)))
    assert "inside out" in row["reason"]
