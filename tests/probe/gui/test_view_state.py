"""What the window knows follows from the events alone."""

from dataclasses import replace

import numpy as np
import pytest
from run_windows import state_of

from drivers import Block, Channel
from probe.core.events import (
    Event,
    Finish,
    Note,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.gui.averaged_beat import averaged_beat
from probe.gui.state import ViewState

PERIOD_S = 0.825


def started(stations: int = 3, **config: object) -> RunStarted:
    plan = {"stations": [[n, 4.0 * (n + 1), 0.0] for n in range(stations)]}
    scene = {"pulse": {"rate_bpm": 60 / PERIOD_S}}
    channels = {
        "virtual": (Channel("force", "N", "force", simulated=True),),
        "stage": (Channel("x", "m"), Channel("y", "m"), Channel("z", "m")),
    }
    return RunStarted(
        0.0, "2026-01-01", {"plan": plan, "scene": scene, "face_mm2": 100.0, **config}, channels
    )


def block(time_s: np.ndarray, force_n: np.ndarray) -> Samples:
    values = force_n[:, None]
    return Samples("virtual", Block(time_s, values, np.zeros(values.shape, bool)), 0, 1)


def press(start_s: float, station: int, pulse_n: float) -> list[Event]:
    t = start_s + np.arange(0, PERIOD_S, 0.002)
    force = 1.0 + pulse_n / 2 * np.sin(2 * np.pi * (t - start_s) / PERIOD_S)
    return [
        StationStarted(start_s - 1, station, 1, 4e-3 * (station + 1), 0.0),
        PhaseEntered(start_s, Phase.HOLDING, station),
        Samples("virtual", Block(t, force[:, None], np.zeros((len(t), 1), bool)), station, 1),
        PhaseEntered(t[-1], Phase.RETRACTING, station),
        StationEnded(start_s + 1, station, 1, True),
    ]


def view(*events: Event) -> ViewState:
    return state_of(events)


def test_a_hold_gives_baseline_and_pulse_as_contact_stress() -> None:
    state = view(started(), *press(1.0, 0, 0.02))
    baseline_pa, pulse_pa, _ = state.maps[0]
    assert baseline_pa == pytest.approx(1e4, rel=1e-3)  # 1 N over 100 mm2
    assert pulse_pa == pytest.approx(200, rel=0.05)
    assert state.simulated == ("virtual.force",)


def test_a_real_heart_is_not_folded_at_the_scenes_rate() -> None:
    real = {"virtual": (Channel("force", "N", "force"),)}
    begun = replace(started(scene={"pulse": {"rate_bpm": 45.0}}), channels=real)
    state = view(begun, *press(1.0, 0, 0.04))
    assert np.isnan(state.maps[0][1])
    assert state.period_s is None
    station = {"station": 1, "baseline_pa": 9950.0, "pulse_pa": 399.0, "pulse_below_pa": None}
    state.judge({"heart_rate_bpm": 60 / PERIOD_S, "stations": [station]})
    assert state.maps[0][:2] == (9950.0, 399.0)
    state.judge({"heart_rate_bpm": None, "stations": [station | {"pulse_below_pa": 500.0}]})
    assert np.isnan(state.maps[0].pulse_pa), "what noise alone may have made is no pulse, nor 0"
    assert (state.maps[0].level_pa, state.maps[0].below_pa) == (9950.0, 500.0)
    state.judge({"heart_rate_bpm": 60 / PERIOD_S, "stations": [station]})
    for event in press(4.0, 1, 0.04):  # not judged yet, but the rate is known
        state.update(event)
    assert state.maps[1][1] == pytest.approx(400.0, rel=0.03)


def test_time_left_comes_from_the_stations_so_far() -> None:
    assert view(started()).time_left_s() is None
    state = view(started(), *press(1.0, 0, 0.0))  # took 2 s of the clock
    assert state.time_left_s() == pytest.approx(4.0)
    state.update(RunEnded(9.0, Finish.ABORTED, "asked"))
    assert state.time_left_s() == 0


def test_a_silent_a_lost_and_a_closed_device_are_distinguished() -> None:
    state = view(started(), block(np.array([0.1]), np.array([0.0])))
    assert state.device_states() == {"virtual": "ok", "stage": "waiting"}
    state.update(PhaseEntered(3.1, Phase.HOLDING, 0))
    assert state.device_states()["virtual"] == "silent 3 s"
    state.update(Note(3.2, "fault", "virtual", "unplugged"))
    assert state.device_states()["virtual"] == "lost"
    state.update(RunEnded(3.3, Finish.FAULTED, "virtual: unplugged"))
    assert state.device_states() == {"virtual": "lost", "stage": "closed"}


def test_the_trace_is_bounded_however_long_the_run() -> None:
    state = view(started())
    for n in range(500):
        t = n + np.arange(0, 1, 0.1)
        state.update(block(t, np.zeros(10)))
    time_s, values = state.traces["virtual"].arrays()
    assert np.ptp(time_s) < 14
    assert len(values) == len(time_s)


def test_a_resumed_run_keeps_what_was_complete() -> None:
    state = view(started(), *press(1.0, 0, 0.0), RunEnded(4.0, Finish.FAULTED, "x"), started())
    assert state.complete == {0}
    assert state.finish is None


def test_a_fault_is_over_once_the_run_is_resumed() -> None:
    broken = [Note(3.0, "fault", "virtual", "unplugged"), RunEnded(4.0, Finish.FAULTED, "virtual")]
    state = view(started(), *press(1.0, 0, 0.0), *broken)
    assert state.device_states()["virtual"] == "lost"
    state = view(started(), *press(1.0, 0, 0.0), *broken, started(), *press(6.0, 1, 0.0))
    assert state.faults == []
    assert state.device_states()["virtual"] == "ok"
    assert [note.words for note in state.notes] == ["virtual: unplugged"]


def test_folding_averages_beats_and_leaves_unseen_parts_unknown() -> None:
    t = np.arange(0, 10 * PERIOD_S, 0.001)
    noise = np.random.default_rng(0).normal(0, 0.5, len(t))
    phase, mean = averaged_beat(t, np.sin(2 * np.pi * t / PERIOD_S) + noise, PERIOD_S)
    assert np.allclose(mean, np.sin(2 * np.pi * phase / PERIOD_S), atol=0.15)
    assert np.isnan(averaged_beat(t[:100], t[:100], PERIOD_S)[1]).sum() > 12


def test_what_was_read_before_or_after_the_hold_is_no_pulse() -> None:
    t = np.arange(0, 3, 0.01)
    steps = np.where((t >= 1) & (t < 2), 1.0, 0.2)  # one block over ramp, hold and retraction
    state = view(
        started(),
        StationStarted(0.0, 0, 1, 0.004, 0.0),
        PhaseEntered(1.0, Phase.HOLDING, 0),
        PhaseEntered(2.0, Phase.RETRACTING, 0),
        block(t, steps),
    )
    assert state.maps[0][:2] == pytest.approx((1e4, 0.0), abs=1e-6)
