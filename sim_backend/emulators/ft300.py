"""An emulated Robotiq FT-300 on the phantom's tip: Modbus RTU and the 100 Hz stream."""

import struct
from contextlib import AbstractContextManager

import numpy as np
from pymodbus.framer import FramerRTU

from sim_backend.emulators.modbus import ModbusSlave
from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom

PERIOD_S = 0.01
STREAM_REGISTER, STREAM_ON = 410, 0x0200
STOP = b"\xff" * 50
COUNTS_PER_N = 100.0
LIMIT = 30000  # counts at full scale, 300 N


class Ft300:
    """Bytes in, bytes out; pressing gives a negative Fz, as with the probe on its face.

    ``noise_n`` is its noise [N rms] in every axis (torques: a tenth of it in Nm).
    """

    def __init__(self, phantom: Phantom, noise_n: float, seed: int) -> None:
        self._phantom = phantom
        self._noise_n = self._usual_noise_n = noise_n
        self._rng = np.random.default_rng(seed)
        registers = {180 + n: (lambda n=n: self._counts(self._now())[n]) for n in range(6)}
        registers |= {190 + n: (lambda n=n: (0, 0, 1000)[n]) for n in range(3)}
        self._slave = ModbusSlave(registers, 9, "rtu", self._written)
        self._next_s: float | None = None  # when the next frame is due; None: not streaming
        self._tail = b""

    @property
    def faults(self) -> tuple[str, ...]:
        """``saturate``: it reads its full scale."""
        return ("saturate", *self._slave.faults)

    def fail(self, fault: str) -> None:
        """Begin a fault."""
        if fault == "saturate":
            self._noise_n = 1e6
        else:
            self._slave.fail(fault)

    def mend(self) -> None:
        """End all faults."""
        self._noise_n = self._usual_noise_n
        self._slave.mend()

    def received(self, data: bytes) -> bytes:
        """While it streams it hears nothing but the stop."""
        if self._next_s is None:
            return self._slave.received(data.lstrip(b"\xff"))
        self._tail = (self._tail + data)[-len(STOP) :]
        if self._tail == STOP:
            self._next_s, self._tail = None, b""
        return b""

    def due(self) -> bytes:
        """The frames that are due."""
        if self._next_s is None:
            return b""
        now, frames = self._now(), b""
        while self._next_s <= now:
            frames += self._frame(self._next_s)
            self._next_s += PERIOD_S
        return frames

    def _frame(self, time_s: float) -> bytes:
        body = b"\x20\x4e" + struct.pack("<6h", *self._counts(time_s))
        return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")

    def _counts(self, time_s: float) -> list[int]:
        force = self._phantom.force_at(time_s)
        wrench = np.array([0.0, 0.0, -force, 0.0, 0.0, 0.0])
        counts = COUNTS_PER_N * (wrench + self._noise_n * self._rng.standard_normal(6))
        return [int(v) for v in np.clip(np.round(counts), -LIMIT, LIMIT)]

    def _written(self, address: int, value: int) -> None:
        if address == STREAM_REGISTER and value == STREAM_ON:
            self._next_s = self._now() + PERIOD_S

    def _now(self) -> float:
        return self._phantom.clock.now()


def emulate(
    phantom: Phantom, *, at: str = "pty", noise_n: float = 0.1, seed: int = 0
) -> AbstractContextManager[Served]:
    """Serve an FT-300; its real noise is about 0.1 N."""
    return served(Ft300(phantom, noise_n, seed), at, "ft300")
