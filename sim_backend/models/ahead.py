"""Stations still to come, solved by a second process while the first ones are pressed.

What a simulated scan will ask is known from its plan. The other process takes stations from the one
on that was asked for first; while it is at the one that is asked for here, the last ones are solved
here: both meet, and no station is solved twice. Answers are the same to the last bit. The other
process is a fresh interpreter and no fork: where it is started there may be windows, guards and
drivers with threads.
"""

import os
import signal
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Condition, Thread
from typing import Any

from drivers.core.child import Child, no_ctrl_c
from sim_backend.models import station_response
from sim_backend.models.response import Station, StationResponse
from sim_backend.models.station_response import is_known, learn, station
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray

END_S = 5.0


class SolvedAhead:
    """`sim_backend.models.station_response.respond` for a scan that will ask for ``stations``.

    No process is started for fewer than two of them that are not known, on a single processor, or
    in a worker of a pool, which has its share of the processors already. `close` ends it.
    """

    def __init__(self, stations: Iterable[Station]) -> None:
        self._waiting = deque(dict.fromkeys(one for one in stations if not is_known(one)))
        self._theirs: Station | None = None  # what the other process solves
        self._child: Child | None = None
        self._news = Condition()
        self._thread = Thread(target=self._share, name="palpate second process", daemon=True)
        if len(self._waiting) > 1 and processors() > 1 and parent_process() is None:
            self._thread.start()

    def __call__(
        self, scene: Scene, x_m: float, max_depth_m: float, array: TaxelArray | None = None
    ) -> StationResponse:
        """The answer of `respond`, and raises what that raises."""
        asked = station(scene, x_m, max_depth_m, array)
        with self._news:
            while self._theirs == asked:
                if not self._waiting:
                    self._news.wait()
                    continue
                last = self._waiting.pop()
                self._news.release()
                try:
                    with suppress(Exception):  # it is met again where it is asked for
                        station_response.respond(*last)
                finally:
                    self._news.acquire()
            if asked in self._waiting:  # what lies before it may never be asked for
                self._waiting.rotate(-self._waiting.index(asked))
                self._waiting.popleft()
        return station_response.respond(scene, x_m, max_depth_m, array)

    def close(self) -> None:
        """End the process, whatever it is doing. One that is still starting ends by itself."""
        with self._news:
            self._waiting.clear()
            child = self._child
        if child is not None:
            child.end(0.0)
            self._thread.join(END_S)

    def _share(self) -> None:
        """Body of the thread: start the process, and hand it one station after the other."""
        try:
            with no_ctrl_c():  # it is for the scan, which lifts the tip
                child = Child(solve_each, (), pipes=1)
        except (EOFError, OSError):  # no process is to be had: all is solved here
            return
        (pipe,), self._child = child.pipes, child
        with suppress(EOFError, OSError):
            while True:
                answer = pipe.recv()  # at first, that it is there
                with self._news:
                    if answer is not None and self._theirs is not None:
                        learn(self._theirs, answer)
                    self._theirs = self._waiting.popleft() if self._waiting else None
                    self._news.notify_all()
                if self._theirs is None:
                    break
                pipe.send(self._theirs)
        with self._news:
            self._theirs = None
            self._news.notify_all()
        child.end(0.0)


def solve_each(pipe: "Connection[Any, Any]") -> None:
    """Body of the process: stations in, answers out, None at first and where there is none. It ends
    with the process at the other end, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be blocked
    with suppress(AttributeError, OSError):  # no precedence, as a process of guards may have
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), 0))
    asked: SimpleQueue[Station] = SimpleQueue()

    def listen() -> None:
        with suppress(EOFError, OSError):
            while True:
                asked.put(pipe.recv())
        os._exit(0)

    Thread(target=listen, daemon=True).start()
    import sim_backend.models.stations  # noqa: F401 - before anything is asked

    answer: StationResponse | None = None
    with suppress(OSError):  # nobody listens any more
        while True:
            pipe.send(answer)
            try:
                answer = station_response.respond(*asked.get())
            except Exception:  # noqa: BLE001 - it is met again where it is asked for
                answer = None


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
