"""What a scan asks its planner, and what it tells it: every choice is checked before it is a press.

A planner is code of others: it may raise, ask for what is none of the plan, or think for long. It
then ends the run, with the probe in the air and the data stored. On the wall clock it thinks in a
thread of its own, so that guards and commands are obeyed meanwhile.
"""

import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import Future, wait
from functools import partial
from typing import TypeVar

from probe.core.cut_stations import record
from probe.core.events import (
    Event,
    Finish,
    PhaseEntered,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.guards.interruption import Interrupted
from probe.planning.plan import Plan
from probe.planning.planner import ALL, Done, Judging, Planner, Press, Told, refusal, whole_press

Answer = TypeVar("Answer")


class Chooser:
    """A planner as the engine sees it.

    Stations that are ``complete`` are not pressed again. Those to ``redo`` are pressed in any case,
    if not before then when the planner is done. ``attempts`` counts the presses begun at each.
    """

    def __init__(
        self,
        planner: Planner,
        plan: Plan,
        complete: Collection[int] = (),
        attempts: Mapping[int, int] | None = None,
        redo: Collection[int] = (),
    ) -> None:
        self.attempts = Counter(attempts or {})
        self._planner, self._plan = planner, plan
        self._complete = set(complete)
        self._redo = [place for place in plan.places if place.index in redo]
        self._places = frozenset(plan.places)
        self._started: RunStarted | None = None
        self._press: list[Event] = []  # that goes on
        self._untold: list[list[Event]] = []
        self._thought: Future[None] | None = None

    def hear(self, event: Event) -> None:
        """Take an event of the run, in their order."""
        listens = isinstance(self._planner, Told)
        match event:
            case RunStarted():
                self._started = self._started or event
            case StationStarted():
                self.attempts[event.station] = event.attempt
                self._press = [event]
            case Samples(station=int()) | PhaseEntered(station=int()) if listens:
                self._press.append(event)
            case StationEnded(complete=True):
                self._complete.add(event.station)
                if listens:
                    self._untold.append([*self._press, event])

    def catch_up(self, events: Iterable[Event]) -> None:
        """Tell the planner of the run so far. Raises `Interrupted` where it fails."""
        for event in events:
            redone = isinstance(event, StationEnded) and event.station not in self._complete
            if not redone:
                self.hear(event)
            self._tell()

    def choose(self, *, threaded: bool) -> "Future[Press | Done]":
        """The next press, or that there is none; its result may raise `Interrupted`."""
        return self._begin(self._choose, threaded)

    def enough(self, now_s: float, *, threaded: bool) -> "Future[bool]":
        """Whether the hold may end that goes on; its result may raise `Interrupted`."""
        begun = self._press[0]
        assert isinstance(begun, StationStarted), "a hold is part of a station"
        events = [*self._press, StationEnded(now_s, begun.station, begun.attempt, complete=True)]
        return self._begin(lambda: self._judge(events), threaded)

    def _judge(self, events: list[Event]) -> bool:
        planner = self._planner
        return isinstance(planner, Judging) and bool(self._asked(planner.enough, events))

    def _tell(self) -> None:
        while self._untold and isinstance(self._planner, Told):
            self._asked(self._planner.tell, self._untold.pop(0))

    def _asked(self, function: Callable[..., Answer], events: list[Event]) -> Answer:
        """``function`` of the recording of one press."""
        assert self._started is not None, "a station is part of a run"
        whole = [self._started, *events]
        return self._guarded(lambda: function(record(whole)))

    def _choose(self) -> Press | Done:
        self._tell()
        choice: object = None
        for _ in range(len(self._places) + 1):
            choice = self._guarded(self._planner.ask)
            if isinstance(choice, Done):
                again = [p for p in self._redo if p.index not in self._complete]
                return whole_press(self._plan, again[0]) if again else choice
            if not isinstance(choice, Press):
                raise self._failed(f"asked for {choice!r:.60}, and not for a Press or Done")
            if choice.place not in self._places:
                raise self._failed(
                    f"asked for {choice.place!r:.120}, which is none of the stations of the plan"
                )
            if choice.place.index not in self._complete:
                if (why := self._guarded(partial(refusal, choice, self._plan))) is not None:
                    raise self._failed(f"asked for what is not allowed: {why}")
                return choice
        if self._complete.issuperset(place.index for place in self._places):
            return Done(ALL)
        raise self._failed(f"asks for nothing but stations that are complete, such as {choice!r}")

    def _guarded(self, work: Callable[[], Answer]) -> Answer:
        try:
            return work()
        except Exception as error:  # it is code of others, and may raise anything
            raise self._failed(f"failed: {type(error).__name__}: {error}") from error

    def _failed(self, why: str) -> Interrupted:
        reason = f"planner {type(self._planner).__name__} {why}"
        return Interrupted(Finish.FAULTED, reason, "planner", retract=True)

    def _begin(self, work: Callable[[], Answer], threaded: bool) -> "Future[Answer]":
        """Begin ``work`` after what was begun before."""
        answer: Future[Answer] = Future()
        before, over = self._thought, Future[None]()

        def think() -> None:
            if before is not None:
                wait([before])
            try:
                answer.set_result(work())
            except BaseException as error:  # noqa: BLE001 - whoever waits for it gets it
                answer.set_exception(error)
            over.set_result(None)

        self._thought = over
        if threaded:
            threading.Thread(target=think, name="palpate planner", daemon=True).start()
        else:
            think()
        return answer
