"""A frame from three touched points, and what points cannot give one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.errors import CalibrationError
from calibration.frame import frame_of, tool_in

ORIGIN_M = np.array([0.4, -0.12, 0.085])
POINTS = np.array([[0.0, 0.0, 0.0], [0.06, 0.0, 0.0], [0.02, 0.03, 0.0]])
MOUNTED = [(0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (180.0, 0.0, 30.0), (20.0, -35.0, 110.0)]


@pytest.mark.parametrize("degrees", MOUNTED, ids=["table", "wall", "ceiling", "any"])
def test_the_mounting_is_found_from_points_on_the_surface(
    degrees: tuple[float, float, float],
) -> None:
    turn = Rotation.from_euler("xyz", degrees, degrees=True)
    frame = frame_of(ORIGIN_M + turn.apply(POINTS))
    assert frame.origin_mm == pytest.approx(1e3 * ORIGIN_M)
    assert (frame.turn.inv() * turn).magnitude() == pytest.approx(0.0, abs=1e-9)
    again = Rotation.from_euler("xyz", frame[1:4], degrees=True)
    assert again.apply(POINTS) + ORIGIN_M == pytest.approx(ORIGIN_M + turn.apply(POINTS))


def test_the_tool_keeps_its_turn_about_the_press_and_is_set_upright() -> None:
    turn = Rotation.from_euler("xyz", (20.0, -35.0, 110.0), degrees=True)
    frame = frame_of(ORIGIN_M + turn.apply(POINTS))
    upright = Rotation.from_rotvec([0.0, np.pi, 0.0]) * Rotation.from_euler("z", 25, degrees=True)
    leaning = turn * Rotation.from_euler("x", 4.0, degrees=True) * upright
    tool, tilt_deg = tool_in(frame, leaning.as_rotvec())
    assert tilt_deg == pytest.approx(4.0)
    assert Rotation.from_rotvec(tool).apply([0.0, 0.0, 1.0]) == pytest.approx([0, 0, -1], abs=1e-9)
    assert (Rotation.from_rotvec(tool).inv() * upright).magnitude() < np.radians(0.2)


def test_points_that_give_no_plane_or_the_other_side_are_refused() -> None:
    with pytest.raises(CalibrationError, match=r"5\.0 mm apart"):
        frame_of(np.array([[0.0, 0, 0], [0.005, 0, 0], [0.02, 0.03, 0]]))
    with pytest.raises(CalibrationError, match=r"1\.0 mm beside the line"):
        frame_of(np.array([[0.0, 0, 0], [0.06, 0, 0], [0.02, 0.001, 0]]))
    mirrored = frame_of(POINTS * [1.0, -1.0, 1.0])
    with pytest.raises(CalibrationError, match="wrong side"):
        tool_in(mirrored, np.array([0.0, np.pi, 0.0]))


def test_what_a_millimetre_does_is_said() -> None:
    exact = frame_of(POINTS)
    off = frame_of(POINTS + np.diag([0.0, 0.0, 1e-3]))
    tilted = np.degrees((exact.turn.inv() * off.turn).magnitude())
    assert tilted == pytest.approx(exact.tilt_per_mm_deg, rel=1e-3)
