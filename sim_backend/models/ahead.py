"""Stations still to come, solved by a second process while the first ones are pressed.

What a simulated scan will ask is known from its plan. The other process begins at the far end, so
that both meet. It says what it begins with, and is told what is begun here: at worst one station is
solved twice, and both answers are the same to the last bit. It is a fresh interpreter and no fork:
where a scan starts there may be windows, guards and drivers with threads.
"""

import os
import signal
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from threading import Condition, Thread
from typing import Any

from drivers.core.child import Child
from sim_backend.models import station_response
from sim_backend.models.response import StationResponse
from sim_backend.models.station_response import Station, is_known, learn, station
from sim_backend.scene.scene_file import Scene

END_S = 5.0
BEGUN, FAILED = "begun", "failed"


class SolvedAhead:
    """`sim_backend.models.station_response.respond` for a scan that will ask for ``stations``.

    No process is started where fewer than two of them are to be solved, on a single processor, or
    in a worker of a pool, which has its share of the processors already. `close` ends it.
    """

    def __init__(self, stations: Iterable[Station]) -> None:
        self._numbers = {
            one: number
            for number, one in enumerate(dict.fromkeys(s for s in stations if not is_known(s)))
        }
        self._theirs: set[Station] = set()  # begun by the other process
        self._ours: set[Station] = set()  # begun by this one
        self._solved: dict[Station, StationResponse] = {}
        self._child: Child | None = None
        self._news = Condition()
        self._ended = len(self._numbers) < 2 or processors() < 2 or parent_process() is not None
        self._thread = Thread(target=self._learn, name="palpate solved ahead", daemon=True)
        if not self._ended:
            self._thread.start()

    def __call__(self, scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
        """The answer of ``scene`` at ``x_m`` [m] down to ``max_depth_m`` [m].

        Raises what `respond` raises.
        """
        one = station(scene, x_m, max_depth_m)
        with self._news:
            if one in self._numbers and one not in self._theirs:
                self._ours.add(one)
                self._tell(one)
            self._news.wait_for(
                lambda: self._ended or one in self._solved or one not in self._theirs
            )
            if one in self._solved:
                learn(one, self._solved[one])
        return station_response.respond(scene, x_m, max_depth_m)

    def close(self) -> None:
        """End the process, whatever it is doing."""
        with self._news:
            self._ended = True
            if self._child is not None and self._child.alive():
                os.kill(self._child.pid, signal.SIGTERM)
        if self._thread.ident is not None:  # it was started
            self._thread.join(END_S)

    def _tell(self, one: Station) -> None:
        if self._child is not None:
            with suppress(OSError):  # it has just ended
                self._child.pipes[0].send(self._numbers[one])

    def _learn(self) -> None:
        """Body of the thread: start the process, take what it has solved, and wait for its end."""
        stations = list(self._numbers)
        child = Child(solve_from_far_end, (stations,), pipes=1)
        with self._news:
            self._child = child
            for one in self._ours:
                self._tell(one)
        with suppress(EOFError, OSError):
            while not self._ended:
                number, what = child.pipes[0].recv()
                with self._news:
                    if what == BEGUN:
                        self._theirs.add(stations[number])
                    elif what == FAILED:  # who asks for it is told why, where it is solved again
                        self._theirs.discard(stations[number])
                    else:
                        self._solved[stations[number]] = what
                    self._news.notify_all()
        with self._news:
            self._ended = True
            self._child = None
            self._news.notify_all()
        child.end(END_S)


def solve_from_far_end(stations: list[Station], pipe: "Connection[Any, Any]") -> None:
    """Body of the process: what is begun elsewhere comes in, beginnings and answers go out.

    It ends with the process at the other end, however that ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the scan's, which lifts the tip
    taken: set[int] = set()

    def listen() -> None:
        try:
            while True:
                taken.add(pipe.recv())
        except (EOFError, OSError):
            os._exit(0)

    Thread(target=listen, daemon=True).start()
    for number in reversed(range(len(stations))):
        if number in taken:
            continue
        pipe.send((number, BEGUN))
        try:
            pipe.send((number, station_response.respond(*stations[number])))
        except Exception:  # noqa: BLE001 - whatever it is, it is met again where it is asked for
            pipe.send((number, FAILED))


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
