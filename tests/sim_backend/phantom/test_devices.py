import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers import Block, DeviceFault, Pose, SimulatedClock
from sim_backend.phantom.devices import virtual_sensor, virtual_stage
from sim_backend.phantom.phantom import Phantom
from sim_backend.phantom.trajectory import Trajectory
from sim_backend.scene.scene_file import load_scene


def world(winkler: Any) -> tuple[SimulatedClock, Phantom]:
    clock = SimulatedClock()
    return clock, Phantom(load_scene("TIHA"), clock, winkler, home=(0.032, 0.0, 1e-3))


def press(winkler: Any, steps_s: list[float], **settings: Any) -> list[Block]:
    """One press read at the given steps."""
    clock, phantom = world(winkler)
    stage, sensor = (
        virtual_stage(clock, phantom=phantom),
        virtual_sensor(clock, phantom=phantom, **settings),
    )
    sensor.start()
    stage.move(Pose(0.032, 0.0, -2.5e-3), 3.5e-3)
    blocks = []
    for step_s in steps_s:
        clock.sleep_until(clock.now() + step_s)
        blocks.append(sensor.read())
    clock.sleep_until(2.0)
    return [*blocks, sensor.read()]


def joined(blocks: list[Block]) -> np.ndarray[Any, Any]:
    return np.concatenate([np.column_stack([b.time_s, b.values]) for b in blocks])


@settings(
    max_examples=30,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # the fixture holds no state
)
@given(st.lists(st.floats(1e-4, 0.3), max_size=6))
def test_samples_do_not_depend_on_how_they_are_read(winkler: Any, steps_s: list[float]) -> None:
    pieces = joined(press(winkler, steps_s, seed=3))
    assert pieces.tobytes() == joined(press(winkler, [], seed=3)).tobytes()


def test_noise_and_steps_are_as_stated(winkler: Any) -> None:
    clock, phantom = world(winkler)
    sensor = virtual_sensor(clock, phantom=phantom, noise_mn=2.0, quantum_mn=0.5, bias_mn=30)
    sensor.start()
    clock.sleep_until(20.0)
    force = sensor.read().values[:, 0]
    assert len(force) == 10_000
    assert force.std() == pytest.approx(2e-3, rel=0.05)
    assert force.mean() == pytest.approx(30e-3, abs=1e-4)
    assert np.allclose(force / 0.5e-3, np.round(force / 0.5e-3))
    sensor.tare()
    clock.sleep_until(22.0)
    assert sensor.read().values[:, 0].mean() == pytest.approx(0, abs=1e-3)


def test_a_clipped_force_is_marked(winkler: Any) -> None:
    block = press(winkler, [], full_scale_n=0.5, noise_mn=0)[0]
    assert block.saturated[-1, 0]
    assert block.values[-1, 0] == 0.5
    assert not block.saturated[0].any()


def test_latency_delays_what_is_felt(winkler: Any) -> None:
    prompt = press(winkler, [], noise_mn=0, quantum_mn=0)[0]
    late = press(winkler, [], noise_mn=0, quantum_mn=0, latency_ms=10)[0]
    assert late.values[5:, 0] == pytest.approx(prompt.values[:-5, 0], abs=1e-12)


def test_a_stopped_stage_comes_to_rest_within_its_acceleration(winkler: Any) -> None:
    clock, phantom = world(winkler)
    stage = virtual_stage(clock, phantom=phantom, acceleration_mm_s2=100)
    stage.move(Pose(0.0, 0.0, 1e-3), 20e-3)
    clock.sleep_until(1.0)
    at = stage.pose().x
    stage.stop()
    stage.stop()
    clock.sleep_until(2.0)
    assert not stage.moving()
    assert at - stage.pose().x == pytest.approx(20e-3**2 / (2 * 0.1), rel=1e-6)


@pytest.mark.parametrize("target, speed, said", [
    (Pose(0.6, 0, 0), 0.01, "x = 600 mm"),
    (Pose(0, 0, 0), 1.0, "1000 mm/s"),
    (Pose(0, 0, math.nan), 0.01, "z = nan"),
])  # fmt: skip
def test_impossible_moves_are_refused(winkler: Any, target: Pose, speed: float, said: str) -> None:
    clock, phantom = world(winkler)
    with pytest.raises(DeviceFault, match=said):
        virtual_stage(clock, phantom=phantom).move(target, speed)


def test_a_followed_stage_carries_the_tip() -> None:
    tip = Trajectory((0.0, 0.0, 0.0))
    for n in range(1, 11):
        tip.record(0.1 * n, (0.0, 0.0, -1e-4 * n))
    tip.record(1.1, (0.0, 0.0, -1e-3 - 1e-6))  # jitter is no motion
    assert tip.point(0.55)[2] == pytest.approx(-5.5e-4)
    assert tip.rest_before(1.2).time_s == pytest.approx(1.0)


def test_a_soft_rig_and_a_wrong_gain(winkler: Any) -> None:
    clock, phantom = world(winkler)
    phantom.scene = load_scene("TI")  # 400 N/m, no pulse
    stage = virtual_stage(clock, phantom=phantom, stiffness_n_mm=1.2)
    sensor = virtual_sensor(clock, phantom=phantom, gain=1.3, noise_mn=0.0, quantum_mn=0.0)
    sensor.start()
    stage.move(Pose(0.032, 0.0, -2e-3), 3e-3)
    clock.sleep_until(2.0)
    assert sensor.read().values[-1, 0] == pytest.approx(1.3 * 300.0 * 2e-3, rel=1e-6)
