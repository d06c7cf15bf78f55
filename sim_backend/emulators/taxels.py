"""A tactile array over serial: what the elements say is on each taxel.

A frame is ``AA 55``, a counter byte, the taxels row by row as big-endian u16 in 10 Pa, and the
Modbus CRC16 of all before it.
"""

import struct
from contextlib import AbstractContextManager

import numpy as np
from pymodbus.framer import FramerRTU

from sim_backend.arrays import Array
from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.array import Taxels, VirtualArray
from sim_backend.phantom.phantom import Phantom

HEADER = b"\xaa\x55"
COUNT_PA = 10.0


class SerialArray:
    """Bytes out."""

    def __init__(self, phantom: Phantom, array: VirtualArray, rate_hz: float, seed: int) -> None:
        self._phantom = phantom
        self._period_s = 1 / rate_hz
        self._taxels = Taxels(phantom, array, "taxels", seed)
        self._rng = np.random.default_rng(seed)
        self._next_s = phantom.clock.now() + self._period_s
        self._counter = 0
        self._dead = False

    @property
    def faults(self) -> tuple[str, ...]:
        """``dead``: the first taxel reads 0."""
        return ("dead",)

    def fail(self, _fault: str) -> None:
        """Lose the first taxel; `Served.fail` refuses any other fault."""
        self._dead = True

    def mend(self) -> None:
        """Have all taxels read."""
        self._dead = False

    def received(self, _data: bytes) -> bytes:
        """It only speaks."""
        return b""

    def due(self) -> bytes:
        """The frames that are due."""
        count = int((self._phantom.clock.now() - self._next_s) // self._period_s) + 1
        if count < 1:
            return b""
        time_s = self._next_s + self._period_s * np.arange(count, dtype=np.float64)
        self._next_s += self._period_s * count
        noise = self._taxels.noise * self._rng.standard_normal((count, len(self._taxels.noise)))
        stress, _ = self._taxels.read(time_s, time_s, noise)
        if self._dead:
            stress[:, 0] = 0.0
        return b"".join(map(self._frame, stress))

    def _frame(self, stress: Array) -> bytes:
        counts = np.clip(np.round(stress / COUNT_PA), 0, 65535).astype(int)
        self._counter = (self._counter + 1) % 256
        body = HEADER + struct.pack(f">B{len(counts)}H", self._counter, *counts)
        return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


def emulate(
    phantom: Phantom,
    *,
    at: str = "pty",
    array: VirtualArray | None = None,
    rate_hz: float = 100.0,
    seed: int = 0,
) -> AbstractContextManager[Served]:
    """Serve an ``array``, by default of 4 x 7 taxels."""
    array = array or VirtualArray(rows=4, columns=7)
    return served(SerialArray(phantom, array, rate_hz, seed), at, "taxels")
