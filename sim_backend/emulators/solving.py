"""Solve in a process of its own what the tip is about to press, so that serving never waits.

A controller holds a move that would go into tissue which is not solved yet, as a real one holds
its moves at a speed slider of 0: positions and forces go on, and nothing is ever made up.
"""

import os
import threading
from contextlib import suppress
from importlib import import_module
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
Press = tuple[tuple[float, float], float]
"""A place (x, y) [m], and down to where it is to be solved [m]."""


class Solver:
    """Sections of a phantom's scene: what was asked for last is solved next, so that a press waits
    for no place that the tip only passed.

    `ready` is what an emulated controller asks before it sets off, and again while it holds a move.
    """

    def __init__(self, phantom: Phantom) -> None:
        self._phantom = phantom
        self._next: Press | None = None
        self._news = threading.Event()
        self._why_not: dict[Press, str] = {}
        self._ended = ""
        with no_ctrl_c():  # it is for who serves, which ends this one
            self._child = Child(solve, (phantom.scene,), pipes=1)
        self._thread = threading.Thread(target=self._learn, name="palpate solver", daemon=True)
        self._thread.start()

    def ready(self, target: Point) -> bool:
        """Whether the tip may go to ``target`` (scan frame) now; if not, it will be solved.

        The air over a place asks for it ahead, and may be entered even where it cannot be solved,
        as at a block's corner, which a finger beyond the edge crushes. Raises `RuntimeError` for a
        press into such a place.
        """
        press = self._phantom.place_of(target), self._phantom.depth_to_solve_m(target)
        if self._known(press):
            return True
        why_not = self._why_not.get(press, self._ended)
        if not why_not:
            self._next = press
            self._news.set()
        if self._phantom.in_air(target):
            return True
        if why_not:
            raise RuntimeError(why_not)
        return False

    def close(self) -> None:
        """End the process."""
        self._next = None
        self._news.set()
        self._child.end(END_S)
        self._thread.join(timeout=END_S)

    def _known(self, press: Press) -> bool:
        place, depth_m = press
        return self._phantom.solved_m(place) >= depth_m

    def _learn(self) -> None:
        pipe = self._child.pipes[0]
        try:
            while self._news.wait():
                self._news.clear()
                if (press := self._next) is None:
                    return
                if self._known(press) or press in self._why_not:
                    continue
                place, depth_m = press
                depths_m = {depth_m, self._phantom.depth_ahead_m(place, depth_m)}
                pipe.send((place, sorted(depths_m, reverse=True), self._phantom.array))
                response, depth_m, why_not = pipe.recv()
                if response is None:
                    self._why_not[press] = why_not
                else:
                    self._phantom.learn(place, depth_m, response)
        except (EOFError, OSError):
            self._ended = "the solver's process has ended"


def solve(scene: Scene, pipe: "Connection[Any, Any]") -> None:
    """Body of the process: places, depths and arrays in, responses out, each down to the first of
    its depths that can be solved."""
    import_module("sim_backend.models.stations")  # now: else the first press waits for it
    from sim_backend.models.station_response import respond

    with suppress(AttributeError, OSError):  # what is served, scanned and guarded comes first
        os.setpriority(os.PRIO_PROCESS, 0, AFTER_OTHERS)
    try:
        while True:
            (x_m, y_m), depths_m, array = pipe.recv()
            answer: Any = None
            for depth_m in depths_m:
                try:
                    section = section_at(scene, 1e3 * y_m)
                    answer = respond(section, x_m, depth_m, array), depth_m, ""
                    break
                except Exception as error:  # noqa: BLE001 - whatever it is, the controller must know
                    where = f"x = {1e3 * x_m:.2f} mm, {1e3 * depth_m:.2f} mm deep"
                    answer = None, depth_m, f"a press at {where}: {error}"
            pipe.send(answer)
    except (EOFError, OSError):
        return  # the emulators have ended
