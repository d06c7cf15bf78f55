"""A base mounted in any way, and a press along any normal."""

import math
import time

import numpy as np
import pytest
from emulated_ur import connected
from scipy.spatial.transform import Rotation

from drivers import Pose
from drivers.ur.sensor import pressed_n
from sim_backend.phantom.phantom import Respond

MOUNTED = [(0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (180.0, 0.0, 30.0), (20.0, -35.0, 110.0)]


@pytest.mark.parametrize("turned", MOUNTED, ids=["table", "wall", "ceiling", "any"])
def test_any_mounting_moves_and_feels_in_the_scan_frame(
    winkler: Respond, turned: tuple[float, float, float]
) -> None:
    keys = dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), turned, strict=True))
    with connected(winkler, keys=keys, rotation_deg=turned) as arm:
        arm.stage.enable()
        arm.sensor.tare()
        arm.sensor.start()
        arm.go(Pose(0.031, 0.0, -0.002), 0.02)
        assert arm.tip_m == pytest.approx((0.031, 0.0, -0.002), abs=1e-6)
        assert arm.stage.pose() == pytest.approx((0.031, 0.0, -0.002, 0, 0, 0), abs=1e-5)
        began_s = arm.clock.now()
        time.sleep(0.3)
        block = arm.sensor.read()
        felt_n = block.values[block.time_s > began_s, 0].mean()
        true_n = arm.phantom.force_n(np.array([began_s + 0.15]))[0]
        assert felt_n == pytest.approx(true_n, rel=0.02)


@pytest.mark.parametrize("slope_deg", [0.0, 29.0, -29.0])
def test_force_on_a_slope_is_the_one_along_the_press(winkler: Respond, slope_deg: float) -> None:
    slope = math.tan(math.radians(slope_deg))

    def surface(x: float, _y: float) -> float:
        return slope * (x - 0.03)

    with connected(winkler, surface=surface) as arm:
        arm.stage.enable()
        tilt = Rotation.from_euler("y", -slope_deg, degrees=True)
        turn = tilt.as_rotvec()
        start = Pose(0.03, 0.0, 0.004, *turn)
        arm.go(start, 0.02)
        arm.sensor.tare()
        arm.sensor.start()
        x, y, z = np.array([0.03, 0.0, 0.0]) - 2e-3 * tilt.apply([0.0, 0.0, 1.0])
        arm.go(Pose(x, y, z, *turn), 0.02)
        began_s = arm.clock.now()
        time.sleep(0.3)
        block = arm.sensor.read()
        held = block.values[block.time_s > began_s]
        true_n = arm.phantom.force_n(np.array([began_s + 0.15]))[0]
        assert true_n > 0.2
        assert held[:, 0].mean() == pytest.approx(true_n, rel=0.02)
        upward_n = held[:, 3].mean()  # what was once taken for the force
        assert upward_n == pytest.approx(true_n * math.cos(math.radians(slope_deg)), rel=0.02)


def test_a_component_in_the_base_frame_can_be_asked_for() -> None:
    wrench, pose = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, math.pi, 0.0)
    assert pressed_n(wrench, pose, "-fy") == -2.0
    assert pressed_n(wrench, pose, "tool") == pytest.approx(3.0)
