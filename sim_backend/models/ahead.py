"""Stations still to come, solved by a second process while the first ones are pressed.

What a simulated scan will ask is known from its plan.
"""

from collections.abc import Iterable

from sim_backend.models import station_response
from sim_backend.models.response import Station, StationResponse
from sim_backend.models.second_process import SecondProcess
from sim_backend.models.station_response import is_known, learn, station
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray


class SolvedAhead:
    """`sim_backend.models.station_response.respond` for a scan that will ask for ``stations``.

    `close` ends the second process.
    """

    def __init__(self, stations: Iterable[Station]) -> None:
        to_solve = dict.fromkeys(one for one in stations if not is_known(one))
        self._numbers = {one: number for number, one in enumerate(to_solve)}
        self._other = SecondProcess(station_response.respond, list(to_solve))

    def __call__(
        self, scene: Scene, x_m: float, max_depth_m: float, array: TaxelArray | None = None
    ) -> StationResponse:
        """The answer of `respond`, and raises what that raises."""
        one = station(scene, x_m, max_depth_m, array)
        if one in self._numbers and not is_known(one):
            found = self._other.answer(self._numbers[one])
            if found is not None:
                learn(one, found)
        return station_response.respond(scene, x_m, max_depth_m, array)

    def close(self) -> None:
        """End the second process, whatever it is doing."""
        self._other.close()
