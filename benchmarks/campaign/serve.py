"""The process in which the truth lives: the world behind a board and a cell on real ports.

`serve` runs until it is told to end, then writes what was true to ``truth.npz``.
"""

import gc
import math
import os
import select
import socket
import time
import tty
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaign.board import Board
from campaign.cell import Cell
from campaign.faults import Draw, Fault
from campaign.strikes import strike
from campaign.world import World

HOME = (10e-3, 0.0, 8e-3)
TICK_S = 1e-3


@dataclass
class Line:
    """One port: a TCP listener with one client, or a pty."""

    address: str
    listener: socket.socket | None
    client: int | None = None
    held: int | None = None  # the far end of a pty, kept open
    _peer: socket.socket | None = None

    def readable(self) -> list[int]:
        """What to wait for."""
        waiting = [] if self.client is None else [self.client]
        return waiting + ([] if self.listener is None else [self.listener.fileno()])

    def take(self, ready: list[int]) -> bytes:
        """Bytes that have arrived; a new client is greeted, a second one sent away."""
        if self.listener is not None and self.listener.fileno() in ready:
            peer, _ = self.listener.accept()
            if self.client is not None:
                peer.close()
            else:
                peer.setblocking(False)
                peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._peer, self.client = peer, peer.fileno()
        if self.client is None or self.client not in ready:
            return b""
        try:
            got = os.read(self.client, 4096)
        except BlockingIOError:
            return b""
        except OSError:
            got = b""
        if not got and self.listener is not None:
            self._hang_up()
        return got

    def send(self, data: bytes) -> None:
        """Send, and forget what a full line does not take."""
        if data and self.client is not None:
            with suppress(OSError):
                os.write(self.client, data)

    def close(self) -> None:
        """Pull the plug."""
        if self.listener is not None:
            self.listener.close()
            self.listener = None
            self._hang_up()
        elif self.client is not None:
            os.close(self.client)
            self.client = None
        if self.held is not None:
            os.close(self.held)
            self.held = None

    def _hang_up(self) -> None:
        if self._peer is not None:
            self._peer.close()
        self._peer = self.client = None


def open_line(*, serial: bool) -> Line:
    """A pty or a TCP port of its own."""
    if serial:
        master, far = os.openpty()
        tty.setraw(far)
        os.set_blocking(master, False)
        return Line(os.ttyname(far), None, master, far)
    listener = socket.create_server(("127.0.0.1", 0))
    return Line(f"socket://127.0.0.1:{listener.getsockname()[1]}", listener)


def serve(draw: Draw, board_line: Line, cell_line: Line, commands: int, folder: Path) -> None:
    """Live until ``commands`` closes; a byte is written there when a fault strikes."""
    come_before_all()
    world = World(draw.bed, time.monotonic(), HOME)
    board, cell = Board(world), Cell(world, draw.seed, draw.zero_n)
    struck = [math.nan] * len(draw.faults)
    pressing = Presses(world)
    late_s = 0.0
    while True:
        watched = [commands, *board_line.readable(), *cell_line.readable()]
        ready, _, _ = select.select(watched, [], [], TICK_S)
        now = time.monotonic()
        late_s = max(late_s, now - world.time_s)
        world.advance(now)
        pressing.look()
        if commands in ready and not os.read(commands, 1):
            break
        for number, fault in enumerate(draw.faults):
            if math.isnan(struck[number]) and now >= due_s(fault, board, pressing):
                struck[number] = now
                strike(fault, world, board, cell)
                os.write(commands, bytes([number]))
        board.received(board_line.take(ready))
        cell_line.take(ready)
        board_line.send(board.due())
        cell_line.send(cell.due())
        for line, device in ((board_line, board), (cell_line, cell)):
            if device.dead:
                line.close()
    save(folder / "truth.npz", world, board, cell, struck, late_s)


def come_before_all() -> None:
    """The truth must not wait for the machine, nor for garbage: looking through all that the
    campaign has imported took 0.07 s, in which every truth on that processor stood still."""
    gc.disable()
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))


class Presses:
    """When the tip was first how deep, press by press."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._station = -1
        self._deep_s: dict[tuple[int, int], float] = {}
        self._in = False

    def look(self) -> None:
        """Note what is new; depths count in steps of 0.05 mm."""
        depth = self._world.depth_m
        if depth <= 0:
            self._in = False
            return
        if not self._in:
            self._in, self._station = True, self._station + 1
        for step in range(int(depth / 0.05e-3) + 1):
            self._deep_s.setdefault((self._station, step), self._world.time_s)

    def when_s(self, station: int, depth_m: float) -> float:
        """When it was; infinite if not yet."""
        return self._deep_s.get((station, int(depth_m / 0.05e-3)), math.inf)


def due_s(fault: Fault, board: Board, pressing: Presses) -> float:
    """When a fault strikes, infinite while that is not known."""
    if math.isnan(fault.pressed_m):
        return board.jogs[0][0] + fault.delay_s if board.jogs else math.inf
    return pressing.when_s(fault.station, fault.pressed_m) + fault.delay_s


def save(
    path: Path, world: World, board: Board, cell: Cell, struck: list[float], late_s: float
) -> None:
    """The truth: times on the machine's monotonic clock [s], metres, newtons.

    It has ended, and gives its turn to those of other runs.
    """
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    jogs = np.array([(t, *target, v) for t, target, v in board.jogs]).reshape(-1, 5)
    part = path.with_stem("part")  # who waits for the file must find all of it
    np.savez(
        part,
        rows=np.array(world.rows).reshape(-1, 8),
        lines=np.array(cell.lines).reshape(-1, 3),
        stops=np.array(board.stops),
        jogs=jogs,
        struck=np.array(struck),
        late_s=late_s,
    )
    part.rename(path)
