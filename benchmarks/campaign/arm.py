"""A UR arm that carries the tip of a `World`: the project's emulated controller speaks RTDE for it.

Only the protocol is the emulator's; where the tip is and what it feels is the campaign's own truth,
which the emulator asks for as it asks the phantom.
"""

import math
import os
import select
import threading
import time
from pathlib import Path
from typing import Any, cast

from campaign.board import Board
from campaign.cell import Cell
from campaign.faults import Draw
from campaign.serve import HOME, TICK_S, Presses, come_before_all, due_s, save
from campaign.strikes import strike
from campaign.world import SLICE_S, Point, World
from sim_backend.emulators.ur import emulate

FAILS = {
    "arm stops to protect": "protective stop",
    "arm stopped in an emergency": "emergency stop",
    "arm loses its program": "lost program",
    "arm silent": "silence",
    "arm gone": "drop",
    "arm cut off": "blink",
}


class Tip:
    """The world as the emulator asks for it; every call from any of its threads."""

    def __init__(self, world: World, board: Board) -> None:
        self._world, self._board = world, board
        self._lock = threading.RLock()
        self.tip = self.clock = self

    def now(self) -> float:
        """The machine's monotonic time."""
        return time.monotonic()

    def move(self, _at_s: float, target: Point, speed_m_s: float, acceleration: float) -> None:
        """Set off."""
        with self._lock:
            self._world.advance(self.now())
            self._world.acceleration_m_s2 = acceleration
            x, y, z = (1e3 * v for v in target)
            self._board.jog((x, y, z), speed_m_s)

    def halt(self, _at_s: float, acceleration: float) -> None:
        """Slow down."""
        with self._lock:
            self._world.advance(self.now())
            self._world.acceleration_m_s2 = acceleration
            self._board.stops.append(self._world.time_s)
            self._world.halt()

    def moving(self, _at_s: float) -> bool:
        """Whether a commanded move lasts."""
        with self._lock:
            self._world.advance(self.now())
            return self._world.moving

    def point(self, at_s: float) -> Point:
        """Where the tip was."""
        row = self._row(at_s)
        return (row[1], row[2], row[3])

    def velocity(self, at_s: float) -> Point:
        """How fast the tip went, over one slice."""
        (x, y, z), (u, v, w) = self.point(at_s), self.point(at_s - SLICE_S)
        return ((x - u) / SLICE_S, (y - v) / SLICE_S, (z - w) / SLICE_S)

    def force_at(self, at_s: float) -> float:
        """What it felt."""
        return self._row(at_s)[4]

    def surface(self, x_m: float, _y_m: float) -> float:
        """How high the bed is; level but for its step."""
        return self._world.bed.surface_m(x_m)

    def locked(self) -> threading.RLock:
        """Held while the world is looked at from outside."""
        return self._lock

    def _row(self, at_s: float) -> tuple[float, ...]:
        with self._lock:
            self._world.advance(self.now())
            rows = self._world.rows
            for n in range(len(rows) - 1, -1, -1):
                if rows[n][0] <= at_s:
                    return rows[n]
            return (at_s, *self._world.place, 0.0, 0.0, 0.0, 0.0)


def serve_arm(draw: Draw, address: str, commands: int, folder: Path) -> None:
    """As `campaign.serve.serve`, with a controller at ``address``."""
    come_before_all()
    world = World(draw.bed, time.monotonic(), HOME)
    board, cell, pressing = Board(world), Cell(world, draw.seed, draw.zero_n), Presses(world)
    struck, late_s = [math.nan] * len(draw.faults), 0.0
    tip = Tip(world, board)
    with emulate(cast(Any, tip), at=address) as controller:
        (folder / "ready").touch()
        while True:
            ready, _, _ = select.select([commands], [], [], TICK_S)
            with tip.locked():
                now = time.monotonic()
                late_s = max(late_s, now - world.time_s)
                world.advance(now)
                pressing.look()
                due = [
                    n for n, fault in enumerate(draw.faults)
                    if math.isnan(struck[n]) and now >= due_s(fault, board, pressing)
                ]  # fmt: skip
                for number in due:
                    struck[number] = now
                    strike(draw.faults[number], world, board, cell)
                    os.write(commands, bytes([number]))
            for number in due:
                if (name := draw.faults[number].kind.name) in FAILS:
                    controller.fail(FAILS[name])
            if ready and not os.read(commands, 1):
                break
        with tip.locked():
            save(folder / "truth.npz", world, board, cell, struck, late_s)
    os._exit(0)
