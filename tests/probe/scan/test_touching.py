"""The surface found by touch, also by a sensor whose single readings do not show it."""

from typing import Any

import numpy as np
import pytest

from drivers import Pose, SimulatedClock
from probe.config.devices import connect
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import Event, Finish, Phase, PhaseEntered, RunEnded, Samples
from probe.scan.engine import run_scan
from sim_backend.scene.scene_file import load_scene

STIFFNESS_N_M = 450.0  # of the springs over TIHA's artery
FT300 = [{"driver": "virtual", "noise_mn": 100.0, "quantum_mn": 10.0, "rate_hz": 100.0}]


def scan(
    respond: Any,
    touch_n: float,
    sensor: Any = None,
    *,
    search_mm: float = 1.0,
    repeats: int = 1,
    retract_mm: float = 2.0,
) -> tuple[RunEnded, list[float], list[float], Pose]:
    """How presses at x = 28 mm ended, where each began and how deep each went [mm], and where
    the tip is in the end."""
    scan_keys = {"start_mm": 28, "stations": 1, "repeats": repeats, "settle_s": 0.3}
    rig = Rig(
        scan=scan_keys | {"touch_n": touch_n, "search_mm": search_mm, "hold_s": 0.1},  # type: ignore[arg-type]
        sensor=sensor or [{"driver": "virtual"}],
        safety={"retract_mm": retract_mm},  # type: ignore[arg-type]
    )
    clock, plan, events = SimulatedClock(), plan_for(rig), list[Event]()
    opened = connect(rig, clock, load_scene("TIHA"), seed=5, respond=respond)
    with opened:
        limits = limits_for(rig, plan)
        ended = run_scan(plan, opened.stage, opened.sensors, clock, events.append, limits)
        last = opened.stage.pose()
    blocks = [e.block for e in events if isinstance(e, Samples) and e.device == "stage"]
    time_s = np.concatenate([block.time_s for block in blocks])
    z_mm = 1e3 * np.concatenate([block.values for block in blocks])[:, 2]
    times = {phase: [e.time_s for e in events if isinstance(e, PhaseEntered) and e.phase is phase]
             for phase in (Phase.INDENTING, Phase.RETRACTING)}  # fmt: skip
    began_mm = np.interp(times[Phase.INDENTING], time_s, z_mm).tolist()
    deepest_mm = np.interp(times[Phase.RETRACTING], time_s, z_mm).tolist()
    return ended, began_mm, deepest_mm, last


def test_touch_finds_the_surface(winkler: Any) -> None:
    ended, began_mm, deepest_mm, _ = scan(winkler, 0.05)
    touch_mm = 1e3 * 0.05 / STIFFNESS_N_M
    assert ended.finish is Finish.COMPLETED
    assert began_mm == [pytest.approx(-touch_mm, abs=0.03)]
    assert deepest_mm == [pytest.approx(-2.5 - touch_mm, abs=0.03)]


def test_a_touch_that_single_readings_do_not_show_is_found_by_their_mean(winkler: Any) -> None:
    """0.27 N, where single readings of an FT-300 show no less than 0.63 N, 1.4 mm deep."""
    ended, began_mm, _, _ = scan(winkler, 0.27, FT300, search_mm=1.3, repeats=8)
    assert ended.finish is Finish.COMPLETED, ended.reason
    touch_mm, late_mm = 1e3 * 0.27 / STIFFNESS_N_M, 0.05
    noise_mm = 1e3 * 0.1 * (2 / 10) ** 0.5 / STIFFNESS_N_M  # of the mean, and of the zero
    assert -np.mean(began_mm) == pytest.approx(touch_mm + late_mm, abs=2 * noise_mm)
    assert (-np.array(began_mm) > touch_mm - 4 * noise_mm).all(), "a surface in the air"


def test_what_was_measured_before_the_tare_is_in_no_mean(winkler: Any) -> None:
    """A tool of 2 N, and a search that begins 10 ms after the tare."""
    heavy = [FT300[0] | {"bias_mn": 2000.0}]
    ended, began_mm, _, _ = scan(winkler, 0.27, heavy, search_mm=1.3, retract_mm=0.6)
    assert ended.finish is Finish.COMPLETED, ended.reason
    assert began_mm[0] < -0.3, "a surface in the air"


def test_a_touch_within_the_noise_is_a_fault_and_not_a_surface_in_the_air(winkler: Any) -> None:
    ended, began_mm, _, last = scan(winkler, 0.05, FT300)
    assert ended.finish is Finish.FAULTED
    assert "touch_n = 0.05 N is within the noise" in ended.reason
    assert began_mm == []
    assert last.z == pytest.approx(2e-3)


def test_nothing_to_touch_is_a_fault_that_says_what_was_felt(winkler: Any) -> None:
    ended, _, _, last = scan(winkler, 2.0)
    assert "no touch of 2 N down to 1 mm" in ended.reason
    assert "where the force is 0.4" in ended.reason  # of 0.45 N; the mean is of the last 0.1 s
    assert "scan.search_mm" in ended.reason
    assert last.z == pytest.approx(2e-3)
