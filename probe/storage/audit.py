"""What must hold for the events of every run, however it ended.

Order, labels, completeness: no sample twice, none under another station's name, no station
complete that is not. `probe.storage.verify` checks the file itself.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from probe.core.contact_stress import FORCE_ROLES
from probe.core.events import (
    Event,
    Finish,
    Note,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.core.places import planned, presses_all
from probe.core.states import ALLOWED, PRESSING

TAIL_S = 0.25  # a press must be measured to within this of its end
POSITION_M = 1e-9
RECENT = 4  # presses that samples just read may belong to
MAX_PROBLEMS = 100  # kept; more are counted
MAX_UNLABELLED = 10_000  # blocks between two stations: minutes at any rate


@dataclass
class Attempt:
    """One press as recorded so far; ``end_s`` is infinite while it goes on."""

    start_s: float
    end_s: float = math.inf
    phases: set[Phase] = field(default_factory=set)
    last_sample_s: float = -math.inf
    last_s: float = -math.inf


@dataclass
class Audit:
    """Feed events to `take`, then ask ``problems``; ``more`` counts those that are not kept."""

    events: int = 0
    sessions: int = 0
    samples: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    complete: set[int] = field(default_factory=set)
    attempts: Counter[int] = field(default_factory=Counter)
    planned: dict[int, tuple[float, float]] = field(default_factory=dict)
    finish: Finish | None = None
    problems: list[str] = field(default_factory=list)
    more: int = 0
    _pressed: set[int] = field(default_factory=set)  # complete since the run was last begun
    _started: RunStarted | None = None
    _presses_all: bool = True
    _phase: Phase = Phase.IDLE
    _last_s: float = -math.inf
    _sampled_s: dict[str, float] = field(default_factory=dict)
    _presses: dict[tuple[int, int], Attempt] = field(default_factory=dict)
    _open: tuple[int, int] | None = None
    _unlabelled: list[tuple[str, float, float]] = field(default_factory=list)

    def take(self, event: Event) -> None:
        """The next event; what is wrong with it is kept in ``problems``."""
        self.events += 1
        for problem in self._judge(event):
            self.add(f"event {self.events}: {problem}")

    def add(self, problem: str) -> None:
        """Keep a problem, or count it if there are too many."""
        if len(self.problems) < MAX_PROBLEMS:
            self.problems.append(problem)
        else:
            self.more += 1

    def end(self) -> None:
        """After the last event; what concerns the whole run comes first."""
        self._break_off()
        whole = list(self._judge_unlabelled())
        if self._started is None:
            whole.append("the run has no beginning")
        missing = set(self.planned) - self.complete if self._presses_all else set()
        if self.finish is Finish.COMPLETED and missing:
            numbers = sorted(index + 1 for index in missing)  # as people count them
            whole.append(f"ended as completed without stations {numbers}")
        self.problems[:0] = whole

    def _judge(self, event: Event) -> Iterator[str]:
        if not isinstance(event, Samples):
            if event.time_s < self._last_s:
                yield f"at {event.time_s:.4f} s, after one at {self._last_s:.4f} s"
            # a note may come while the last samples of a press that has ended are awaited
            if not isinstance(event, Note):
                self._last_s = max(self._last_s, event.time_s)
        if not isinstance(event, RunStarted) and (self._started is None or self.finish is not None):
            yield "outside of a run"
        match event:
            case RunStarted():
                yield from self._start(event)
            case RunEnded(_, finish, _):
                self.finish = finish
            case StationStarted():
                yield from self._start_station(event)
            case PhaseEntered(_, phase, _):
                if self._scanned() and phase not in ALLOWED[self._phase]:
                    yield f"{phase} cannot follow {self._phase}"
                self._phase = phase
                if self._open is not None:
                    self._presses[self._open].phases.add(phase)
            case Samples():
                yield from self._sample(event)
            case StationEnded():
                yield from self._end_station(event)
            case Note():
                pass

    def _start(self, event: RunStarted) -> Iterator[str]:
        self._break_off()
        yield from self._judge_unlabelled()
        if self._started is None:
            self._started = event
            self.planned = planned(event.config)
        elif dict(event.channels) != dict(self._started.channels):
            yield "goes on with other channels than it began with"
        self.sessions += 1
        self._presses_all = presses_all(event.config)
        self._phase, self._open, self.finish, self._pressed = Phase.IDLE, None, None, set()

    def _start_station(self, event: StationStarted) -> Iterator[str]:
        key = (event.station, event.attempt)
        yield from self._judge_unlabelled()
        if self._open is not None:
            yield f"station {event.station + 1} begins before station {self._open[0] + 1} has ended"
        self.attempts[event.station] += 1
        if event.attempt != self.attempts[event.station]:
            yield (
                f"attempt {event.attempt} at station {event.station + 1} should be "
                f"{self.attempts[event.station]}"
            )
        if event.station in self._pressed:  # a resumed run may press it again, one scan may not
            yield f"station {event.station + 1} was complete already"
        place = self.planned.get(event.station)
        if place is None:
            yield f"station {event.station + 1} is not in the plan"
        elif not all(
            abs(a - b) <= POSITION_M or (math.isnan(a) and math.isnan(b))
            for a, b in zip(place, (event.x_m, event.y_m), strict=True)
        ):
            yield f"station {event.station + 1} is not where it was planned"
        self._open = key
        self._presses[key] = Attempt(event.time_s)
        if len(self._presses) > RECENT:
            del self._presses[next(iter(self._presses))]

    def _end_station(self, event: StationEnded) -> Iterator[str]:
        key = (event.station, event.attempt)
        if key != self._open:
            yield f"station {event.station + 1}, attempt {event.attempt} ends without a beginning"
            return
        self._open = None
        press = self._presses[key]
        press.end_s = event.time_s
        if not event.complete:
            return
        self.complete.add(event.station)
        self._pressed.add(event.station)
        scanned = self._scanned()
        if scanned and (missing := [phase for phase in PRESSING if phase not in press.phases]):
            yield f"station {event.station + 1} is complete without {', '.join(missing)}"
        # an imported recording ends one of its own periods after its last sample
        if scanned and press.last_sample_s < event.time_s - TAIL_S:
            yield f"station {event.station + 1} is complete, but its last samples are not in"

    def _scanned(self) -> bool:
        """Whether this is a scan of our own: an import has only what its file had."""
        return self._started is not None and "imported" not in self._started.config

    def _sample(self, event: Samples) -> Iterator[str]:
        block, device = event.block, event.device
        channels = self._started.channels.get(device) if self._started else None
        if channels is None or len(channels) != block.values.shape[1]:
            yield f"a block of samples does not fit the channels of {device}"
            return
        self.samples[device] += len(block.time_s)
        self.lost[device] += block.lost
        if not len(block.time_s):
            return
        first, last = float(block.time_s[0]), float(block.time_s[-1])
        before = self._sampled_s.get(device, -math.inf)
        if not (first > before and (np.diff(block.time_s) > 0).all()):  # nor is not-a-number
            yield f"samples of {device} twice or out of order at {first:.4f} s"
        self._sampled_s[device] = last
        if event.station is None or event.attempt is None:
            self._unlabelled.append((device, first, last))
            if len(self._unlabelled) > MAX_UNLABELLED:
                yield from self._judge_unlabelled()
            return
        press = self._presses.get((event.station, event.attempt))
        if press is None or not press.start_s <= first <= last < press.end_s:
            number = event.station + 1
            yield f"samples of {device} at {first:.4f} s do not belong to station {number}"
            return
        press.last_s = max(press.last_s, last)
        if any(channel.role in FORCE_ROLES for channel in channels):
            press.last_sample_s = max(press.last_sample_s, last)

    def _break_off(self) -> None:
        """A killed scan has not said when its press ended: no later than its last sample."""
        if self._open is not None:
            press = self._presses[self._open]
            press.end_s = max(press.start_s, press.last_s)
            self._open = None

    def _judge_unlabelled(self) -> Iterator[str]:
        """Samples of no station must lie outside all; known only once the station has ended."""
        for device, first, last in self._unlabelled:
            for (station, _), press in self._presses.items():
                if first < press.end_s and last >= press.start_s:
                    yield f"samples of {device} at {first:.4f} s belong to station {station + 1}"
        self._unlabelled.clear()
