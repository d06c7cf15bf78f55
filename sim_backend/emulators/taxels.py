"""A tactile array over serial: each taxel feels its share of the mean contact stress.

A frame is ``AA 55``, a counter byte, the taxels row by row as big-endian u16 in 10 Pa, and the
Modbus CRC16 of all before it.
"""

import struct
from contextlib import AbstractContextManager

import numpy as np
from pymodbus.framer import FramerRTU

from sim_backend.arrays import Array
from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom

HEADER = b"\xaa\x55"
COUNT_PA = 10.0


class TaxelArray:
    """Bytes out; the stress falls off towards the edges as under a round finger (Hertz)."""

    def __init__(
        self, phantom: Phantom, rows: int, columns: int, rate_hz: float, noise_pa: float, seed: int
    ) -> None:
        self._phantom = phantom
        self._period_s = 1 / rate_hz
        self._noise_pa = noise_pa
        self._rng = np.random.default_rng(seed)
        self._next_s = phantom.clock.now() + self._period_s
        self._counter = 0
        self._face_m2 = 1e-6 * phantom.scene.face_mm2
        x = (np.arange(columns) + 0.5) / columns * 2 - 1
        row: Array = np.sqrt(1 - x**2)
        self._whole = np.tile(row / row.mean(), rows)
        self.mend()

    @property
    def faults(self) -> tuple[str, ...]:
        """``dead``: the first taxel reads 0."""
        return ("dead",)

    def fail(self, _fault: str) -> None:
        """Lose the first taxel; `Served.fail` refuses any other fault."""
        self._share[0] = 0.0

    def mend(self) -> None:
        """Have all taxels read."""
        self._share = self._whole.copy()

    def received(self, _data: bytes) -> bytes:
        """It only speaks."""
        return b""

    def due(self) -> bytes:
        """The frames that are due."""
        now, frames = self._phantom.clock.now(), b""
        while self._next_s <= now:
            frames += self._frame(self._next_s)
            self._next_s += self._period_s
        return frames

    def _frame(self, time_s: float) -> bytes:
        force = self._phantom.force_at(time_s)
        noise = self._noise_pa * self._rng.standard_normal(len(self._share))
        stress = force / self._face_m2 * self._share + noise
        counts = np.clip(np.round(stress / COUNT_PA), 0, 65535).astype(int)
        self._counter = (self._counter + 1) % 256
        body = HEADER + struct.pack(f">B{len(counts)}H", self._counter, *counts)
        return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


def emulate(
    phantom: Phantom,
    *,
    at: str = "pty",
    rows: int = 4,
    columns: int = 7,
    rate_hz: float = 100.0,
    noise_pa: float = 20.0,
    seed: int = 0,
) -> AbstractContextManager[Served]:
    """Serve an array of ``rows`` x ``columns`` taxels."""
    return served(TaxelArray(phantom, rows, columns, rate_hz, noise_pa, seed), at, "taxels")
