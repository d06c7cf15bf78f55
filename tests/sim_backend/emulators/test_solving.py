"""A controller holds a press until its place is solved; serving goes on meanwhile."""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from programs import python
from waiting import until

from drivers import Pose, SimulatedClock, WallClock
from sim_backend import load_scene
from sim_backend.emulators.serving import served
from sim_backend.emulators.solving import Solver
from sim_backend.models.station_response import respond
from sim_backend.phantom.phantom import Phantom, Respond, Response
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray

OFF_THE_RASTER = (0.0223, 0.0, -0.0015)


def never(_scene: Scene, _x_m: float, _depth_m: float) -> Response:
    raise AssertionError("nothing is solved where it is served")


@pytest.fixture
def solver() -> Iterator[Solver]:
    phantom = Phantom(load_scene("TI"), WallClock(), never, home=(0.0223, 0.0, 0.004))
    made = Solver(phantom)
    yield made
    made.close()


def test_a_place_is_solved_elsewhere_and_to_the_digit(solver: Solver) -> None:
    began = time.monotonic()
    assert not solver.ready(OFF_THE_RASTER)
    assert time.monotonic() - began < 0.5  # whatever it takes to solve
    until(lambda: solver.ready(OFF_THE_RASTER), 60.0)
    phantom = solver._phantom
    phantom.tip.move(phantom.clock.now(), OFF_THE_RASTER, 1.0, 100.0)
    felt = phantom.force_n(np.array([phantom.clock.now() + 1.0]))
    here = Phantom(load_scene("TI"), SimulatedClock(), respond, home=(0.0223, 0.0, 0.004))
    here.tip.move(0.0, OFF_THE_RASTER, 1.0, 100.0)
    assert felt == here.force_n(np.array([1.0]))
    assert felt[0] > 0.1


def test_an_array_s_taxels_are_solved_elsewhere_too(solver: Solver) -> None:
    phantom, array = solver._phantom, TaxelArray(1, 5)
    phantom.feel_with(array)
    until(lambda: solver.ready(OFF_THE_RASTER), 60.0)
    phantom.tip.move(phantom.clock.now(), OFF_THE_RASTER, 1.0, 100.0)
    at = np.array([phantom.clock.now() + 1.0])
    taxels = phantom.taxels_n(at)
    assert taxels.shape == (1, 1, 5)
    assert taxels.sum() == pytest.approx(phantom.force_n(at)[0], rel=1e-9)


def test_the_air_needs_no_solution_but_asks_for_it(solver: Solver) -> None:
    above = (0.0223, 0.0, 0.004)
    assert solver.ready(above)
    until(lambda: solver.ready(OFF_THE_RASTER), 60.0)  # asked for while the tip was above


def test_a_corner_that_is_only_passed_holds_up_nothing(solver: Solver) -> None:
    """A finger that overlaps a block's edge by 2 mm crushes its corner: no press, but the air."""
    with pytest.raises(RuntimeError, match=r"x = -3.00 mm, 2.50 mm deep: .* crushed"):
        until(lambda: solver.ready((-0.003, 0.0, -0.0025)), 60.0)
    assert solver.ready((-0.003, 0.0, 0.004))
    until(lambda: solver.ready(OFF_THE_RASTER), 60.0)


def test_a_press_waits_for_no_place_that_was_only_passed(solver: Solver) -> None:
    passed = [(1e-3 * x, 0.0) for x in range(5, 20)]
    assert all(solver.ready((*place, 0.004)) for place in passed)
    until(lambda: solver.ready(OFF_THE_RASTER), 60.0)
    assert sum(solver._phantom.solved_m(place) > 0 for place in passed) <= 1


def test_a_press_in_segments_is_held_seldom(solver: Solver) -> None:
    """Beyond what was first solved, each time for a quarter more."""
    held, depth_m = 0, 2.0e-3
    while (depth_m := depth_m + 0.1e-3) < 4.5e-3:
        target = (*OFF_THE_RASTER[:2], -depth_m)
        held += not solver.ready(target)
        until(lambda target=target: solver.ready(target), 60.0)
    assert held <= 4


def test_the_first_press_waits_for_no_import() -> None:
    solver = """
from multiprocessing import Pipe
import sys
from sim_backend.emulators.solving import solve
ours, theirs = Pipe()
ours.close()
solve(None, theirs)
print("sim_backend.models.stations" in sys.modules)
"""
    assert python("-c", solver, status=0).stdout == "True\n"


class Crushing:
    """A device that is pressed into what cannot be solved."""

    faults = ()

    def received(self, _data: bytes) -> bytes:
        return b""

    def due(self) -> bytes:
        raise RuntimeError("a press at x = -3.00 mm")

    def fail(self, fault: str) -> None: ...


def test_what_cannot_be_solved_closes_the_line_and_says_why(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with served(Crushing(), "pty", "grbl"):
        pass
    assert capsys.readouterr().err == "grbl: its line is closed: a press at x = -3.00 mm\n"


def test_a_robot_holds_its_move_and_goes_on_telling(winkler: Respond) -> None:
    from emulated_ur import connected  # here: it skips where the robot's client is not

    solved = [False]
    with connected(winkler, ready=lambda target: solved[0] or target[2] > 0) as made:
        made.stage.enable()
        made.go(Pose(0.031, 0.0, 0.002), 0.02)
        made.stage.move(Pose(0.031, 0.0, -0.002), 0.02)
        end_s = made.clock.now() + 1.0
        while made.clock.now() < end_s:
            assert made.stage.moving()
            assert made.stage.pose().z == pytest.approx(0.002, abs=1e-6)
            time.sleep(0.02)
        assert made.stage.pace == 0.0
        solved[0] = True
        made.arrive()
        assert made.stage.pose().z == pytest.approx(-0.002, abs=1e-6)
