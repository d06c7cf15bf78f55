"""Axes on a line, whoever makes them: mistakes of a driver, a stop amid a homing, late answers."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager

import pytest
from waiting import until

from drivers import DeviceFault, MotionFault, Pose
from drivers.core.abilities import enable
from drivers.core.axes import Axes, LineStageSettings, Reading
from drivers.core.line import Line, NoAnswer
from drivers.core.line_stage import LineStage


class MistakenAxes:
    names = "z"

    def read(self) -> Reading:
        return Reading({"z": 0.0}, moving=False)

    def move(self, places_mm: Mapping[str, float], speeds_mm_s: Mapping[str, float]) -> None:
        del speeds_mm_s
        places_mm["x"]

    def ready(self) -> None: ...

    def stop(self) -> None: ...

    def close(self) -> None: ...


@contextmanager
def connected(axes: Callable[[], Axes]) -> Iterator[LineStage]:
    with closing(LineStage(LineStageSettings(name="mine", port="-"), axes)) as stage:
        stage.connect()
        yield stage


def test_a_mistake_in_a_driver_is_said_as_what_it_is() -> None:
    with connected(MistakenAxes) as stage:
        with pytest.raises(
            DeviceFault, match=r"mine: driver: ready\(\) gave None; it gives a list"
        ):
            enable(stage)
        with pytest.raises(DeviceFault, match="mine: driver: KeyError: 'x'"):
            stage.move(Pose(0.0, 0.0, 1e-3), 1e-3)


def test_a_move_to_where_it_is_asks_the_controller_nothing() -> None:
    """An empty command is one that a controller may take for anything."""
    axes = HomedByHalf()
    with connected(lambda: axes) as stage:
        stage.move(stage.pose(), 1e-3)
        assert not stage.moving()
        assert not axes.moves


class OneAxisStays(MistakenAxes):
    """x arrives and z stays where it was."""

    names = "xz"

    def __init__(self) -> None:
        self.x_mm = 0.0

    def read(self) -> Reading:
        return Reading({"x": self.x_mm, "z": 0.0}, moving=False)

    def move(self, places_mm: Mapping[str, float], speeds_mm_s: Mapping[str, float]) -> None:
        del speeds_mm_s
        self.x_mm = places_mm["x"]


def test_every_axis_must_have_arrived() -> None:
    with connected(OneAxisStays) as stage:
        stage.move(Pose(2e-3, 0.0, 1e-3), 1e-3)
        with pytest.raises(MotionFault, match=r"came to rest 1\.00 mm from its target"):
            until(lambda: not stage.moving(), 5.0)


class Misunderstood(MistakenAxes):
    def __init__(self) -> None:
        self.stops = 0

    def stop(self) -> None:
        self.stops += 1
        raise NoAnswer("mine", "what?")


def test_a_stop_that_is_answered_wrongly_is_repeated_but_not_without_end() -> None:
    """4,090 times in a third of a second: no controller's buffer holds that."""
    axes = Misunderstood()
    stage = LineStage(LineStageSettings(name="mine", port="-", silent_s=0.3), lambda: axes)
    stage.connect()
    stage.stop()
    time.sleep(0.2)
    stage.close()
    assert 2 <= axes.stops <= 45


class HomedByHalf(MistakenAxes):
    """Stopped by somebody as soon as its only axis homes."""

    def __init__(self) -> None:
        self.homing = False
        self.moves: list[Mapping[str, float]] = []
        self.stopped: Callable[[], None] = lambda: None

    def read(self) -> Reading:
        return Reading({"z": 0.0}, moving=self.homing)

    def home(self, _axis: str) -> None:
        self.homing = True
        self.stopped()

    def move(self, places_mm: Mapping[str, float], speeds_mm_s: Mapping[str, float]) -> None:
        del speeds_mm_s
        self.moves.append(places_mm)

    def stop(self) -> None:
        self.homing = False


def test_a_stop_while_the_last_axis_homes_leaves_no_way_to_the_park() -> None:
    axes = HomedByHalf()
    keys = LineStageSettings(name="mine", port="-", park_mm=(0.0, 0.0, 5.0))
    stage = LineStage(keys, lambda: axes)
    axes.stopped = stage.stop
    stage.connect()
    try:
        with pytest.raises(DeviceFault, match="stopped on the way to its home"):
            stage.home()
        assert not axes.moves
    finally:
        stage.close()


class SlowPort:
    """A device whose answer may come after its question's deadline."""

    def __init__(self) -> None:
        self.arrived = b""
        self.answer = b""

    @property
    def in_waiting(self) -> int:
        return len(self.arrived)

    def write(self, _data: bytes) -> None:
        self.arrived += self.answer

    def read(self, size: int = 1) -> bytes:
        found, self.arrived = self.arrived[:size], self.arrived[size:]
        return found

    def reset_input_buffer(self) -> None:
        self.arrived = b""


def test_an_answer_after_its_deadline_is_not_the_next_question_s(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    port = SlowPort()
    monkeypatch.setattr("drivers.core.line.open_port", lambda *_: port)
    line = Line("mine", "-", 9600, answer_s=0.01)
    with pytest.raises(NoAnswer):
        line.ask(b"x?", size=3)
    port.arrived, port.answer = b"x=1", b"y=2"
    assert line.ask(b"y?", size=3) == b"y=2"
