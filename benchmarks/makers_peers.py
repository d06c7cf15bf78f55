"""Devices at whose other end stands their maker's own library: an LSL stream, and Standa's axes.

Each is tied to a phantom, and fails on command like those of `sim_backend.emulators`.
"""

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from drivers import DeviceFault, Stage
from sim_backend.phantom.phantom import Phantom

RATE_HZ = 200.0
LATE_S, BUNCH_S = 0.4, 0.1
JUMP_S = 2.0
LOOK_S = 0.002
STILL_M = 1e-8  # libximc's virtual axes do not jitter
START_MM = {"x": 20.0, "z": 3.0}  # where the scan begins; a virtual axis begins at 0


class LslStream:
    """The phantom's force as a stream of liblsl, stamped when it was felt.

    ``late`` and ``bunches`` hold samples back, ``jump`` stamps them seconds too late.
    """

    faults = ("silence", "drop", "nan", "jump", "late", "bunches")

    def __init__(self, phantom: Phantom, noise_n: float = 0.001) -> None:
        import pylsl

        self.name = f"palpate-{uuid4()}"
        info = pylsl.StreamInfo(self.name, "force", 1, RATE_HZ, pylsl.cf_double64, self.name)
        self._outlet: Any = pylsl.StreamOutlet(info)
        self._stamp_s = pylsl.local_clock
        self._phantom, self._noise_n = phantom, noise_n
        self._fault: str | None = None
        self._rng = np.random.default_rng(0)
        self._held: list[tuple[float, float]] = []
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._send, name="LSL stream", daemon=True)
        self._thread.start()

    def fail(self, fault: str | None) -> None:
        """Begin one of ``faults``."""
        self._fault = fault

    def close(self) -> None:
        """End the stream."""
        self._end.set()
        self._thread.join()

    def _send(self) -> None:
        due_s = self._stamp_s()
        while not self._end.is_set():
            due_s = max(due_s + 1 / RATE_HZ, self._stamp_s())
            self._end.wait(max(due_s - self._stamp_s(), 0.0))
            if self._fault == "drop":
                self._outlet = None
                return
            self._held.append((self._force_n(), self._stamp_s()))
            if self._fault == "silence":
                self._held.clear()
            waits_s = {"late": LATE_S, "bunches": BUNCH_S}.get(self._fault or "", 0.0)
            if self._stamp_s() - self._held[0][1] >= waits_s if self._held else False:
                jump_s = JUMP_S if self._fault == "jump" else 0.0
                ready = len(self._held) if self._fault == "bunches" else 1
                for force_n, stamp_s in self._held[:ready]:
                    self._outlet.push_sample([force_n], stamp_s + jump_s)
                del self._held[:ready]

    def _force_n(self) -> float:
        if self._fault == "nan":
            return math.nan
        now_s = self._phantom.clock.now()
        force_n = self._phantom.force_at(now_s)
        return force_n + self._noise_n * float(self._rng.standard_normal())


@contextmanager
def lsl_stream(phantom: Phantom) -> Iterator[LslStream]:
    """Within: a stream that liblsl sends."""
    made = LslStream(phantom)
    try:
        yield made
    finally:
        made.close()


class StandaAxes:
    """libximc's virtual axes, which carry the phantom's tip.

    They are in the driver's own process, so that there is no line to cut: ``unplugged`` takes all
    of them from the library, ``z unplugged`` that of z. What such an axis does then nobody sees.
    """

    faults = ("unplugged", "z unplugged")

    def __init__(self, phantom: Phantom, folder: Path) -> None:
        self.keys = {f"{axis}_uri": f"xi-emu:///{folder}/{axis}.bin" for axis in START_MM}
        self._phantom = phantom
        self._stage: Any = None
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="Standa axes", daemon=True)

    def carry(self, stage: Stage) -> None:
        """From now on the tip is where ``stage`` is, once that is connected."""
        self._stage = stage
        self._thread.start()

    def fail(self, fault: str) -> None:
        """Begin one of ``faults``."""
        for axis in "xz" if fault == "unplugged" else "z":
            self._stage._open[axis].close_device()

    def close(self) -> None:
        """End what carries the tip."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()

    def _carry(self) -> None:
        while not self._end.wait(LOOK_S):
            try:
                here = self._stage.pose()
            except DeviceFault:  # not connected yet, or unplugged
                continue
            self._phantom.tip.record(self._phantom.clock.now(), here[:3], STILL_M)


@contextmanager
def standa_axes(phantom: Phantom, folder: Path) -> Iterator[StandaAxes]:
    """Within: axes of libximc."""
    made = StandaAxes(phantom, folder)
    try:
        yield made
    finally:
        made.close()
