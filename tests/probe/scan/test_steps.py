"""A press in steps: each is held, at its depth or its force, and the last as every press is."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from springs import on_simulated_springs, run_springs, spring_rig

from probe.config.rig import Rig
from probe.core.events import Finish
from probe.detection.scan import detect
from probe.scan.session import scan
from probe.storage.run import open_run

HELD_S = 0.8


def held(**keys: Any) -> tuple[list[float], list[float], list[str]]:
    """Depths [mm] and forces [N] of springs of 1 N/mm at which one press was held, and notes."""
    bed, stage, sensor = on_simulated_springs(stiffness_n_m=1000.0)
    rig = spring_rig(
        scan={"step_hold_s": HELD_S, "hold_s": HELD_S, **keys}, safety={"max_force_n": 5.0}
    )
    ran = run_springs(bed, stage, [sensor], rig=rig)
    assert ran.finish is Finish.COMPLETED, ran.reason
    deep_mm = np.round(-1e3 * ran.height_m[ran.height_m < -1e-4], 3)
    depths, milliseconds = np.unique(deep_mm, return_counts=True)
    at_mm = depths[milliseconds > 900 * HELD_S].tolist()
    return at_mm, [0.001 * 1000.0 * mm for mm in at_mm], ran.notes


def test_each_depth_is_held() -> None:
    at_mm, _, notes = held(steps_mm=[0.5, 1.0, 1.75, 2.25])
    assert at_mm == pytest.approx([0.5, 1.0, 1.75, 2.25], abs=2e-3)
    assert notes == []


def test_each_force_is_held() -> None:
    _, forces_n, notes = held(steps_n=[0.3, 0.8, 1.6])
    assert forces_n == pytest.approx([0.3, 0.8, 1.6], rel=0.05)
    assert notes == []


def test_after_a_force_that_is_not_reached_no_other_is_tried() -> None:
    at_mm, _, notes = held(steps_n=[0.3, 1.5, 2.0, 3.0], indentation_mm=1.0)
    assert at_mm == pytest.approx([0.3, 1.0], abs=0.02)
    assert [note for note in notes if "asked for" in note] == [
        "station 1: pressed to 1 N, 1.00 mm deep, and not to the 1.5 N asked for: "
        "that is as deep as scan.indentation_mm allows"
    ]


def test_force_and_pulse_of_every_step_are_in_the_finding(tmp_path: Path, winkler: Any) -> None:
    """Of springs whose pulse grows with depth: A p d / 2.5 mm."""
    keys = {"start_mm": 32.0, "stations": 1, "steps_mm": [0.5, 1.25, 2.5]}
    rig = Rig.model_validate({"scan": {**keys, "step_hold_s": 2.5, "hold_s": 2.5}})
    run = open_run(scan(rig, "TIHA", tmp_path, respond=winkler).path)
    found = detect(run)
    depths_mm, forces_n, pulses_n = np.array(
        [[1e3 * step.depth_m, step.force_n, step.pulse_n] for step in found.steps]
    ).T
    assert depths_mm == pytest.approx([0.5, 1.25, 2.5], abs=0.01)
    assert forces_n == pytest.approx(0.49 * depths_mm, rel=0.05)
    assert pulses_n == pytest.approx(2e-6 * 40 * 133.3 * depths_mm / 2.5, rel=0.2)
    assert [step["depth_mm"] for step in found.as_json()["steps"]] == pytest.approx(depths_mm)
    assert "the pulse is greatest" in repr(found)
    assert "not less at the last: it may grow beyond" in repr(found)


def test_a_press_at_once_has_no_steps(tmp_path: Path, winkler: Any) -> None:
    rig = Rig.model_validate({"scan": {"start_mm": 32.0, "stations": 1}})
    found = detect(open_run(scan(rig, "TIHA", tmp_path, respond=winkler).path))
    assert found.steps == ()
    assert "steps" not in found.as_json()
