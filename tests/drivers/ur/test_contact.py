"""A search that a UR's controller ends at a contact, by itself, and goes back to where it began."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from emulated_ur import PATIENT_S, Rig, connected, until
from waiting import first_of_all

from drivers import DeviceFault, MotionFault, Pose
from sim_backend.emulators.ur import CB3, UrController
from sim_backend.phantom.phantom import Respond

CONTACT_N = 0.2
LOWEST = Pose(0.03, 0.0, -1.5e-3)
SPEED_M_S = 2e-3
OTHERS: tuple[int, int, int, int] = (5, 3, 1, 64192)


@contextmanager
def searching(respond: Respond, contact_n: float = CONTACT_N) -> Iterator[tuple[Rig, UrController]]:
    """A rig whose controller looks for contact, under way down from 0.5 mm above the surface."""
    keys = {"contact": "controller", "stop_s": PATIENT_S}
    with first_of_all(), connected(respond, keys=keys, contact_n=contact_n) as (made, robot):
        made.stage.enable()
        made.stage.move(LOWEST._replace(z=0.5e-3), 0.05)
        made.arrive(PATIENT_S)
        made.stage.search(LOWEST, SPEED_M_S)
        yield made, robot


def go_deep(made: Rig) -> None:
    """Press beyond any contact: nothing may look for it any more."""
    made.stage.move(LOWEST, 0.02)
    made.arrive(PATIENT_S)
    assert made.stage.pose().z == pytest.approx(LOWEST.z, abs=1e-4)
    assert not made.stage.touched


def test_the_controller_stops_at_contact_and_goes_back_to_where_it_began(winkler: Respond) -> None:
    with searching(winkler) as (made, _):
        assert not made.stage.touched
        made.arrive(PATIENT_S)
        assert made.stage.touched
        assert made.stage.pose().z == pytest.approx(0.0, abs=SPEED_M_S * 2.5e-3)
        stiffness_n_m = 476.0  # of the stand-in there, 1 % more or less by its pulse
        assert made.deepest_m == pytest.approx(-CONTACT_N / stiffness_n_m, abs=0.02e-3)
        made.stage.move(LOWEST._replace(z=2e-3), 0.05)
        assert not made.stage.touched
        made.arrive(PATIENT_S)
        go_deep(made)


def test_while_it_goes_back_it_says_that_it_has_touched(winkler: Respond) -> None:
    """A force that falls then is no fault of the sensor's."""
    with searching(winkler) as (made, robot):
        until(lambda: robot.robot.contact.steps_back > 0)
        until(lambda: made.stage.touched)
        assert made.stage.moving()  # nobody has asked the controller yet


def test_no_contact_is_an_arrival(winkler: Respond) -> None:
    with searching(winkler, math.inf) as (made, robot):
        made.arrive(PATIENT_S)
        assert not made.stage.touched
        assert made.stage.pose().z == pytest.approx(LOWEST.z, abs=1e-4)
        robot.robot.contact.contact_n = CONTACT_N
        made.stage.move(LOWEST._replace(z=0.5e-3), 0.02)
        made.arrive(PATIENT_S)
        go_deep(made)


def test_a_stop_in_a_search_is_one_and_ends_it(winkler: Respond) -> None:
    with searching(winkler) as (made, robot):
        time.sleep(0.1)
        made.stage.stop()
        made.arrive(PATIENT_S)
        assert not made.stage.touched
        assert made.stage.pose().z > 0
        assert robot.robot.playing
        go_deep(made)


def test_another_move_ends_the_search(winkler: Respond) -> None:
    with searching(winkler) as (made, _):
        time.sleep(0.1)
        go_deep(made)
        assert made.deepest_m == pytest.approx(LOWEST.z, abs=1e-4)


def test_a_stop_on_the_way_back_leaves_the_program_alone(winkler: Respond) -> None:
    """The program obeys nothing then; that the way back has ended is taken for its answer."""
    with searching(winkler, 0.7) as (made, robot):
        until(lambda: robot.robot.contact.steps_back > 0)
        made.stage.stop()
        made.arrive(PATIENT_S)
        assert robot.robot.playing
        assert made.stage.pose().z == pytest.approx(0.0, abs=SPEED_M_S * 2.5e-3)
        go_deep(made)


def test_a_contact_from_before_a_search_is_none(winkler: Respond) -> None:
    """The library waits until there is no contact; the scan's own stop is there for this."""
    with searching(winkler) as (made, _):
        made.arrive(PATIENT_S)
        made.stage.move(LOWEST._replace(z=-1e-3), 0.02)
        made.arrive(PATIENT_S)
        made.stage.search(LOWEST, SPEED_M_S)
        made.arrive(PATIENT_S)
        assert not made.stage.touched
        assert made.stage.pose().z == pytest.approx(LOWEST.z, abs=1e-4)


def test_what_only_keeps_the_arm_from_going_on_is_no_contact(winkler: Respond) -> None:
    with searching(winkler, math.inf) as (made, _):
        time.sleep(0.1)
        made.phantom.tip.halt(made.clock.now(), 10.0)
        with pytest.raises(MotionFault, match="came to rest"):
            made.arrive(PATIENT_S)
        assert not made.stage.touched


def test_a_protective_stop_in_a_search_is_reported(winkler: Respond) -> None:
    with searching(winkler) as (made, robot):
        time.sleep(0.05)
        robot.fail("protective stop")
        time.sleep(0.05)
        with pytest.raises(DeviceFault, match="protective stop"):
            made.stage.moving()
        assert not made.stage.touched


@pytest.mark.parametrize("version", [CB3, OTHERS])
def test_a_controller_that_has_no_contact_detection_is_refused(
    winkler: Respond, version: tuple[int, int, int, int]
) -> None:
    """The library's program for it would report a contact at once, and not stop."""
    with connected(winkler, keys={"contact": "controller"}, version=version) as (made, robot):
        with pytest.raises(DeviceFault, match=r"needs PolyScope 5\.4 or newer; this is .*3\."):
            made.stage.enable()
        assert robot.robot.uploads == 0
