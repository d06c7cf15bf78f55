"""Stations still to come, solved by other processes while the first ones are pressed.

What a simulated scan will ask is known from its plan, and workers take its stations in that order.
While one is at the station that is asked for here, the last ones are solved here: both meet, and no
station is solved twice. Answers are the same to the last bit.
"""

import os
from collections.abc import Iterable
from concurrent.futures import Future
from contextlib import suppress
from itertools import takewhile
from multiprocessing import parent_process

from drivers.core.processes import Workers
from sim_backend.models import station_response
from sim_backend.models.response import Station, StationResponse
from sim_backend.models.station_response import is_known, learn, station
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray


class SolvedAhead:
    """`sim_backend.models.station_response.respond` for a scan that will ask for ``stations``.

    Every other processor of this machine has a worker. None is started where there is no other, for
    fewer than two stations that are not known, or in a worker of a pool, which has its share of the
    processors already. `close` ends them.
    """

    def __init__(self, stations: Iterable[Station]) -> None:
        unknown = dict.fromkeys(place for place in stations if not is_known(place))
        self._theirs: dict[Station, Future[StationResponse]] = {}
        self._workers: Workers | None = None
        count = min(processors(), len(unknown)) - 1
        if count > 0 and parent_process() is None:
            self._workers = Workers(count)
            for place in unknown:
                self._submit(place)

    def __call__(
        self, scene: Scene, x_m: float, max_depth_m: float, array: TaxelArray | None = None
    ) -> StationResponse:
        """The answer of `respond`, and raises what that raises."""
        asked = station(scene, x_m, max_depth_m, array)
        self._put_off(asked)
        theirs = self._theirs.pop(asked, None)
        if theirs is not None and not theirs.cancel():
            while not theirs.done() and (last := self._taken_back()) is not None:
                with suppress(Exception):  # it is met again where it is asked for
                    station_response.respond(*last)
            with suppress(Exception):  # met again below, or the worker has ended
                learn(asked, theirs.result())
        return station_response.respond(scene, x_m, max_depth_m, array)

    def _submit(self, place: Station) -> None:
        assert self._workers is not None
        with suppress(OSError, RuntimeError):  # no process is to be had: it is solved here
            self._theirs[place] = self._workers.submit(station_response.respond, *place)

    def _put_off(self, asked: Station) -> None:
        """What lies before ``asked`` comes last: in a resumed scan it may never be asked for."""
        before = takewhile(lambda place: place != asked, list(self._theirs))
        for place in before if asked in self._theirs else ():
            if self._theirs[place].cancel():
                del self._theirs[place]
                self._submit(place)

    def _taken_back(self) -> Station | None:
        """The last station that no worker has begun."""
        for place, theirs in reversed(list(self._theirs.items())):
            if theirs.cancel():
                self._theirs.pop(place, None)
                return place
        return None

    def close(self) -> None:
        """End the workers, whatever they are doing."""
        if self._workers is not None:
            self._workers.kill()


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
