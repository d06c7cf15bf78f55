"""A search that a UR's controller ends at a contact, by itself, and goes back to where it began."""

import math
import time
from collections.abc import Iterator

import pytest
from emulated_ur import PATIENT_S, Arm, connected, until
from waiting import first_of_all

from drivers import DeviceFault, MotionFault, Pose
from sim_backend.emulators.ur import CB3
from sim_backend.phantom.phantom import Respond

CONTACT_N = 0.2
LOWEST = Pose(0.03, 0.0, -1.5e-3)
SPEED_M_S = 2e-3
OTHERS: tuple[int, int, int, int] = (5, 3, 1, 64192)


@pytest.fixture
def searching(winkler: Respond, request: pytest.FixtureRequest) -> Iterator[Arm]:
    """Its controller looks for a contact, under way down from 0.5 mm above the surface."""
    keys = {"contact": "controller", "stop_s": PATIENT_S}
    contact_n = getattr(request, "param", CONTACT_N)
    with first_of_all(), connected(winkler, keys=keys, contact_n=contact_n) as made:
        made.stage.enable()
        made.go(LOWEST._replace(z=0.5e-3), 0.05)
        made.stage.search(LOWEST, SPEED_M_S)
        yield made


def for_contact_of(force_n: float) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("searching", [force_n], indirect=True)


def go_deep(made: Arm) -> None:
    """Press beyond any contact: nothing may look for it any more."""
    made.go(LOWEST, 0.02)
    assert made.stage.pose().z == pytest.approx(LOWEST.z, abs=1e-4)
    assert not made.stage.touched


def test_the_controller_stops_at_contact_and_goes_back_to_where_it_began(searching: Arm) -> None:
    assert not searching.stage.touched
    searching.arrive()
    assert searching.stage.touched
    assert searching.stage.pose().z == pytest.approx(0.0, abs=SPEED_M_S * 2.5e-3)
    stiffness_n_m = 476.0  # of the stand-in there, 1 % more or less by its pulse
    assert searching.deepest_m == pytest.approx(-CONTACT_N / stiffness_n_m, abs=0.02e-3)
    searching.stage.move(LOWEST._replace(z=2e-3), 0.05)
    assert not searching.stage.touched
    searching.arrive()
    go_deep(searching)


def test_while_it_goes_back_it_says_that_it_has_touched(searching: Arm) -> None:
    """A force that falls then is no fault of the sensor's."""
    until(lambda: searching.robot.contact.steps_back > 0)
    until(lambda: searching.stage.touched)
    assert searching.stage.moving()  # nobody has asked the controller yet


@for_contact_of(math.inf)
def test_no_contact_is_an_arrival(searching: Arm) -> None:
    searching.arrive()
    assert not searching.stage.touched
    assert searching.stage.pose().z == pytest.approx(LOWEST.z, abs=1e-4)
    searching.robot.contact.contact_n = CONTACT_N
    searching.go(LOWEST._replace(z=0.5e-3), 0.02)
    go_deep(searching)


def test_a_stop_in_a_search_is_one_and_ends_it(searching: Arm) -> None:
    time.sleep(0.1)
    searching.stage.stop()
    searching.arrive()
    assert not searching.stage.touched
    assert searching.stage.pose().z > 0
    assert searching.robot.playing
    go_deep(searching)


def test_another_move_ends_the_search(searching: Arm) -> None:
    time.sleep(0.1)
    go_deep(searching)
    assert searching.deepest_m == pytest.approx(LOWEST.z, abs=1e-4)


@for_contact_of(0.7)
def test_a_stop_on_the_way_back_leaves_the_program_alone(searching: Arm) -> None:
    """The program obeys nothing then; that the way back has ended is taken for its answer."""
    until(lambda: searching.robot.contact.steps_back > 0)
    searching.stage.stop()
    searching.arrive()
    assert searching.robot.playing
    assert searching.stage.pose().z == pytest.approx(0.0, abs=SPEED_M_S * 2.5e-3)
    go_deep(searching)


def test_a_contact_from_before_a_search_is_none(searching: Arm) -> None:
    """The library waits until there is no contact; the scan's own stop is there for this."""
    searching.arrive()
    searching.go(LOWEST._replace(z=-1e-3), 0.02)
    searching.stage.search(LOWEST, SPEED_M_S)
    searching.arrive()
    assert not searching.stage.touched
    assert searching.stage.pose().z == pytest.approx(LOWEST.z, abs=1e-4)


@for_contact_of(math.inf)
def test_what_only_keeps_the_arm_from_going_on_is_no_contact(searching: Arm) -> None:
    time.sleep(0.1)
    searching.phantom.tip.halt(searching.clock.now(), 10.0)
    with pytest.raises(MotionFault, match="came to rest"):
        searching.arrive()
    assert not searching.stage.touched


def test_a_protective_stop_in_a_search_is_reported(searching: Arm) -> None:
    time.sleep(0.05)
    searching.fail("protective stop")
    time.sleep(0.05)
    with pytest.raises(DeviceFault, match="protective stop"):
        searching.stage.moving()
    assert not searching.stage.touched


@pytest.mark.parametrize(
    "arm",
    [{"enable": False, "keys": {"contact": "controller"}, "version": v} for v in (CB3, OTHERS)],
    indirect=True,
)
def test_a_controller_that_has_no_contact_detection_is_refused(arm: Arm) -> None:
    """The library's program for it would report a contact at once, and not stop."""
    with pytest.raises(DeviceFault, match=r"needs PolyScope 5\.4 or newer; this is .*3\."):
        arm.stage.enable()
    assert arm.robot.uploads == 0
