"""An approach that an emulated UR's controller ends at contact: every outcome by the engine."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from threading import Timer
from typing import Any

import pytest
from emulated_ur import PATIENT_S, Arm, connected
from waiting import first_of_all

from probe.core.events import Event, Finish, Phase, PhaseEntered, RunEnded
from probe.guards.safety_monitor import SafetyMonitor
from probe.planning.limits import Limits
from probe.planning.plan import Place, Plan
from probe.scan.engine import run_scan
from sim_backend.phantom.phantom import Respond

PLAN = Plan(
    places=(Place(0, 0.03, 0.0),), indentation_m=0.5e-3, ramp_s=0.5, hold_s=0.3,
    clearance_m=2e-3, travel_m_s=0.02, approach_m_s=2e-3, touch_n=0.05, search_m=1e-3,
)  # fmt: skip
BOX = ((-0.01, 0.07), (-0.01, 0.01), (-0.01, 0.05))
LIMITS = Limits(10.0, 3e-3, BOX, 0.03, silence_s=8.0, late_s=8.0, hardest_n_m=5e3, engine_s=10.0)
STIFF_N_M = 4e3


@pytest.fixture
def stiff(winkler: Callable[..., Any]) -> Respond:
    return lambda *asked: replace(winkler(*asked), stiffness_n_m=STIFF_N_M, area_m2=0.0)


@contextmanager
def rig(respond: Respond, contact_n: float) -> Iterator[Arm]:
    keys = {"contact": "controller", "stop_s": PATIENT_S, "watchdog_s": 0.5}
    with first_of_all(), connected(respond, keys=keys, contact_n=contact_n) as made:
        yield made


def scan(made: Arm, plan: Plan = PLAN) -> tuple[RunEnded, list[Event]]:
    """One press."""
    events: list[Event] = []
    return run_scan(plan, made.stage, [made.sensor], made.clock, events.append, LIMITS), events


def lifted(made: Arm) -> bool:
    return made.tip_m[2] > PLAN.travel_z_m - 1e-4


@pytest.fixture
def blind(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scan sees no force that could end its approach; its guards do."""
    monkeypatch.setattr(SafetyMonitor, "force_n", lambda _self: 0.0)


@pytest.mark.usefixtures("blind")
def test_the_press_begins_where_contact_began(stiff: Respond) -> None:
    """Of 2 N, which the scan has not seen, the arm goes back; that is no fault of the sensor's."""
    with rig(stiff, 2.0) as made:
        ended, events = scan(made)
        assert ended.finish is Finish.COMPLETED, ended.reason
        pressing_s = next(
            e.time_s for e in events
            if isinstance(e, PhaseEntered) and e.phase is Phase.INDENTING
        )  # fmt: skip
        began_m = made.phantom.tip.point(pressing_s)[2]
        assert began_m == pytest.approx(0.0, abs=5e-6)
        assert -made.deepest_m == pytest.approx(2.0 / STIFF_N_M, abs=15e-6)


def test_the_scans_own_touch_comes_first_where_the_controller_feels_less(winkler: Respond) -> None:
    with rig(winkler, 3.0) as made:
        ended, _ = scan(made)
        assert ended.finish is Finish.COMPLETED, ended.reason
        assert not made.stage.touched


def test_no_contact_at_all_ends_at_the_search_depth(winkler: Respond) -> None:
    with rig(winkler, 3.0) as made:
        ended, _ = scan(made, replace(PLAN, touch_n=2.0))
        assert ended.finish is Finish.FAULTED
        assert "no touch of 2 N down to 1 mm below" in ended.reason
        assert -made.deepest_m == pytest.approx(PLAN.search_m, abs=1e-5)
        assert lifted(made)


def noting(stop: Callable[[float], Any], heard: list[float]) -> Callable[[float], Any]:
    """``stop``, whose times are noted in ``heard``."""

    def noted(at_s: float) -> Any:
        heard.append(at_s)
        return stop(at_s)

    return noted


def test_contact_in_the_air_is_a_fault(winkler: Respond, monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot's program drops it if it obeys a command at that moment, as a machine that is late
    with its commands has it do; the scan's own touch then finds the surface, and it is tried again.
    """
    for _ in range(5):
        heard: list[float] = []
        with rig(winkler, 3.0) as made:
            contact = made.robot.contact
            monkeypatch.setattr(contact, "stop", noting(contact.stop, heard))
            contact.misled = True
            ended, _ = scan(made)
            if not heard:
                assert ended.finish is Finish.COMPLETED, ended.reason
                assert -made.deepest_m == pytest.approx(PLAN.indentation_m, abs=0.15e-3)
                continue
            assert ended.finish is Finish.FAULTED
            assert "the probe may be in the air" in ended.reason
            height = re.search(r"([+-][0-9.]+) mm from the planned surface", ended.reason)
            assert height is not None
            where_m = made.phantom.tip.point(heard[0])[2]  # it sets off before the program looks
            assert where_m > 0
            assert float(height[1]) == pytest.approx(1e3 * where_m, abs=0.05)
            assert lifted(made)
            return
    pytest.fail("the program dropped each contact")


@pytest.mark.parametrize("fault, said, up", [
    ("protective stop", "protective stop", False),
    ("lost program", "control program has stopped", False),
    ("blink", "connection lost", True),
])  # fmt: skip
def test_a_fault_in_a_search_ends_the_scan_as_without_the_option(
    winkler: Respond, fault: str, said: str, up: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not up:  # it will never answer
        monkeypatch.setattr("probe.guards.retreat.PATIENCE_S", 2.0)
    with rig(winkler, 3.0) as made:
        begin = made.robot.contact.start

        def strike(now: float) -> None:
            begin(now)
            Timer(0.05, made.fail, (fault,)).start()

        made.robot.contact.start = strike
        ended, _ = scan(made)
        assert ended.finish is Finish.FAULTED
        assert said in ended.reason
        assert lifted(made) is up
