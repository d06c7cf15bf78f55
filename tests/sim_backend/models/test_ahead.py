"""Workers solve what a scan comes to later: the same answers, and never left behind."""

import multiprocessing
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from small_block import BLOCK
from waiting import until

from drivers import SimulatedClock
from palpate import Rig, connect
from sim_backend import Scene, SceneError
from sim_backend.models import ahead, station_response
from sim_backend.models import stations as stations_solved
from sim_backend.models.ahead import SolvedAhead
from sim_backend.models.response import Station
from sim_backend.models.station_response import respond, station

DEPTH_M = 1e-3
PLACES_M = [9e-3, 10e-3, 11e-3, 12e-3, 13e-3]  # the last is the mirror image of 11 mm


@pytest.fixture(autouse=True)
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "processors", lambda: 2)
    monkeypatch.setattr(station_response, "_kept", {})


def begun(both: SolvedAhead) -> bool:
    return any(theirs.running() for theirs in both._theirs.values())


def stations(scene: Scene = BLOCK) -> list[Station]:
    return [station(scene, x_m, DEPTH_M) for x_m in PLACES_M]


@pytest.fixture
def solved() -> Iterator[Callable[..., SolvedAhead]]:
    made: list[SolvedAhead] = []

    def make(of: list[Station]) -> SolvedAhead:
        made.append(SolvedAhead(of))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_both_processes_answer_to_the_last_bit(
    solved: Callable[..., SolvedAhead], monkeypatch: pytest.MonkeyPatch
) -> None:
    both = solved(stations())
    until(lambda: all(theirs.done() for theirs in both._theirs.values()), 60.0)
    answers = [both(BLOCK, x_m, DEPTH_M) for x_m in PLACES_M]
    monkeypatch.setattr(station_response, "_kept", {})
    alone = [respond(BLOCK, x_m, DEPTH_M) for x_m in PLACES_M]
    assert [pickle.dumps(one) for one in answers] == [pickle.dumps(one) for one in alone]


def test_what_is_being_solved_elsewhere_is_waited_for(
    solved: Callable[..., SolvedAhead], monkeypatch: pytest.MonkeyPatch
) -> None:
    both = solved(stations())
    until(lambda: begun(both), 60.0)
    monkeypatch.setattr(stations_solved, "solved", None)  # nothing can be solved here
    assert both(BLOCK, PLACES_M[0], DEPTH_M).x_m == PLACES_M[0]


def test_meanwhile_the_last_stations_are_solved_here_and_none_twice(
    solved: Callable[..., SolvedAhead], monkeypatch: pytest.MonkeyPatch
) -> None:
    both, here = solved(stations()), []
    until(lambda: begun(both), 60.0)

    def solve(one: Station) -> Any:
        here.append(one.x_m)
        return of_station(one)

    of_station = stations_solved.solved
    monkeypatch.setattr(stations_solved, "solved", solve)
    for x_m in PLACES_M:
        both(BLOCK, x_m, DEPTH_M)
    assert len(here) == len(set(here)) < 4  # of four, one is an image
    assert not here or here[0] in (12e-3, 10e-3)  # the last, unless the first came just then


def test_it_goes_on_from_what_was_asked_for_first(solved: Callable[..., SolvedAhead]) -> None:
    """A resumed scan, of which the first ones were complete."""
    places = [station(BLOCK, x_m, DEPTH_M) for x_m in (5e-3, 6e-3, 7e-3, 8e-3, *PLACES_M)]
    both = solved(places)
    both(BLOCK, PLACES_M[0], DEPTH_M)
    behind = list(both._theirs)[-3:]
    assert set(behind) <= set(places[:4])  # a worker may have begun the first


@pytest.mark.parametrize(("processors", "places"), [(1, 4), (2, 1)])
def test_no_process_where_it_would_gain_nothing(
    processors: int, places: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ahead, "processors", lambda: processors)
    assert SolvedAhead(stations()[:places])._workers is None


def test_where_no_process_can_be_started_all_is_solved_here(
    solved: Callable[..., SolvedAhead], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_given: object, **_keys: object) -> None:
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", refused)
    assert solved(stations())(BLOCK, PLACES_M[0], DEPTH_M).x_m == PLACES_M[0]


def test_no_process_where_everything_is_known() -> None:
    for one in stations():
        station_response.learn(one, respond(*stations()[0]))
    assert SolvedAhead(stations())._workers is None


def test_where_it_cannot_be_solved_the_reason_is_said(solved: Callable[..., SolvedAhead]) -> None:
    lump = {"kind": "tumour", "x_mm": 15.1001, "depth_mm": 5.0, "diameter_mm": 2.0,
            "modulus_kpa": 500.0, "poisson": 0.45}  # fmt: skip
    content = BLOCK.model_dump()
    touching = Scene.model_validate(content | {"inclusion": [*content["inclusion"], lump]})
    hopeless = station(touching, PLACES_M[3], DEPTH_M)
    both = solved([hopeless, *stations()[:2]])
    until(lambda: all(theirs.done() for theirs in both._theirs.values()), 60.0)
    with pytest.raises(SceneError, match="too little to be meshed"):
        both(*hopeless)
    both(BLOCK, PLACES_M[0], DEPTH_M)


def test_without_the_workers_everything_is_solved_here(solved: Callable[..., SolvedAhead]) -> None:
    both = solved(stations())
    until(lambda: begun(both), 60.0)
    assert both._workers is not None
    both._workers.kill()
    for x_m in PLACES_M:
        assert both(BLOCK, x_m, DEPTH_M).x_m == x_m


def test_it_ends_with_a_parent_that_is_killed() -> None:
    start = (
        "import sys, time\n"
        "from palpate import load_scene\n"
        "from sim_backend.models import ahead\n"
        "ahead.processors = lambda: 2\n"
        "scene = load_scene('TIHA-solid')\n"
        "one = ahead.SolvedAhead([ahead.station(scene, 1e-3 * x, 2.51e-3) for x in range(4, 30)])\n"
        "while not any(theirs.running() for theirs in one._theirs.values()): time.sleep(0.02)\n"
        "print('begun', flush=True)\n"
        "time.sleep(600)\n"
    )
    # the worker inherits stdout: its end is the end of both, long before a station is solved
    with subprocess.Popen([sys.executable, "-c", start], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline().strip() == b"begun"
        parent.kill()
        assert parent.communicate(timeout=15)[0] == b""


def test_devices_end_it_when_they_are_closed() -> None:
    rig = Rig(scan={"start_mm": 4.0, "stations": 4, "pitch_mm": 4.0, "indentation_mm": 1.0})
    before = set(multiprocessing.active_children())
    with connect(rig, SimulatedClock(), BLOCK):
        ours = set(multiprocessing.active_children()) - before
        assert len(ours) == 1
    assert not ours & set(multiprocessing.active_children())
