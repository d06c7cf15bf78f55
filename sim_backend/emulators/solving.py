"""Solve in a process of its own what the tip is about to press, so that serving never waits.

A controller holds a move that would go into tissue which is not solved yet, as a real one holds
its moves at a speed slider of 0: positions and forces go on, and nothing is ever made up.
"""

import math
import os
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from drivers.core.child import Child, no_ctrl_c
from sim_backend.phantom.phantom import Phantom
from sim_backend.phantom.trajectory import Point
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.slicing import section_at

END_S = 1.0
AFTER_OTHERS = 5
"""Nice value: after what is served, scanned and guarded, yet before a busy machine's other work. Of
three grids of 25 presses (UR and FT-300, two processors, load 9 to 15) three were completed with 5;
with 15 none, as a place was not solved within the 82 s that a scan waits for a held move."""
Place = tuple[float, float]


class Solver:
    """Sections of a phantom's scene, solved in the order in which they are asked for.

    `ready` is what an emulated controller asks before it sets off.
    """

    def __init__(self, phantom: Phantom) -> None:
        self._phantom = phantom
        self._asked: dict[Place, float] = {}
        self._why_not = ""
        with no_ctrl_c():  # it is for who serves, which ends this one
            self._child = Child(solve, (phantom.scene,), pipes=1)
        self._thread = threading.Thread(target=self._learn, name="palpate solver", daemon=True)
        self._thread.start()

    def ready(self, target: Point) -> bool:
        """Whether the tip may go to ``target`` (scan frame) now; if not, it will be solved.

        Raises `RuntimeError` if it cannot be solved.
        """
        place = self._phantom.place_of(target)
        depth_m = self._phantom.depth_to_solve_m(target)
        if self._phantom.solved_m(place) >= depth_m:
            return True
        if self._asked.get(place, -math.inf) < depth_m:
            self._asked[place] = depth_m
            self._child.pipes[0].send((place, depth_m, self._phantom.array))
        if self._why_not:
            raise RuntimeError(self._why_not)
        return self._phantom.in_air(target)

    def close(self) -> None:
        """End the process."""
        self._child.end(END_S)
        self._thread.join(timeout=END_S)

    def _learn(self) -> None:
        try:
            while True:
                place, depth_m, response, why_not = self._child.pipes[0].recv()
                if response is None:
                    self._why_not = why_not
                else:
                    self._phantom.learn(place, depth_m, response)
        except (EOFError, OSError):
            self._why_not = self._why_not or "the solver's process has ended"


def solve(scene: Scene, pipe: "Connection[Any, Any]") -> None:
    """Body of the process: places, depths and arrays in, responses out."""
    from sim_backend.models.station_response import respond

    with suppress(AttributeError, OSError):  # what is served, scanned and guarded comes first
        os.setpriority(os.PRIO_PROCESS, 0, AFTER_OTHERS)
    try:
        while True:
            (x_m, y_m), depth_m, array = pipe.recv()
            try:
                found: Any = respond(section_at(scene, 1e3 * y_m), x_m, depth_m, array)
                pipe.send(((x_m, y_m), depth_m, found, ""))
            except Exception as error:  # noqa: BLE001 - whatever it is, the controller must know
                pipe.send(((x_m, y_m), depth_m, None, f"{type(error).__name__}: {error}"))
    except (EOFError, OSError):
        return  # the emulators have ended
