"""What every sensor on a line shares: a thread that reads it, and a bounded buffer.

A driver gives a `Source`: the open line, used by the one thread only. Readings are raw; tare and
saturation are the same for all and done here.
"""

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from drivers.core.errors import ConfigError, DeviceAbsent, DeviceFault, as_fault
from drivers.core.protocols import MAX_RATE_HZ, Block, Channel, Clock

BUFFER_S = 5.0
TARE_S = 0.1  # a tare is the mean over this long
# A device that is there answers within this long, or five periods: opening its port resets an
# Arduino, whose bootloader takes up to 2 s; HX711 sketches then settle and tare for 3.6 s at 10 Hz.
FIRST_S = 6.0
JOIN_S = 2.0


class Sample(NamedTuple):
    """One reading: scan time, one value per channel, samples missing right before it.

    ``jumped_s`` as in `Block`.
    """

    time_s: float
    values: Sequence[float]
    lost: int = 0
    jumped_s: float = 0.0


class Source(Protocol):
    """An open line to a sensor."""

    def read(self) -> list[Sample]:
        """What has arrived, waiting a fraction of a second at most.

        Raises `OSError` or `DeviceFault` if the line is lost.
        """
        ...

    def close(self) -> None:
        """Leave the device as it was found and release the line."""
        ...


class LineSensor:
    """A `Sensor` over a `Source`; ``open_source`` raises `DeviceAbsent` if there is none.

    Raises `ConfigError` for a rate above `MAX_RATE_HZ`.

    ``full_scale`` of a channel is compared with the raw reading. Samples beyond `BUFFER_S` unread
    ones push out the oldest, which count as lost. ``simulated`` marks every channel: an emulator
    stands at the other end.
    """

    def __init__(
        self,
        clock: Clock,
        name: str,
        channels: tuple[Channel, ...],
        rate_hz: float,
        open_source: Callable[[], Source],
        *,
        simulated: bool = False,
    ) -> None:
        if not rate_hz <= MAX_RATE_HZ:
            raise ConfigError(f"rate_hz = {rate_hz:g}: must be at most {MAX_RATE_HZ:g}")
        self.name = name
        self.channels = tuple(replace(channel, simulated=simulated) for channel in channels)
        self.rate_hz = rate_hz
        self._clock = clock
        self._open = open_source
        scales = [np.inf if c.full_scale is None else c.full_scale for c in channels]
        self._full_scale = np.array(scales)
        self._limit = max(round(BUFFER_S * rate_hz), 10)
        self._waiting: deque[Sample] = deque()
        self._recent: deque[Sample] = deque(maxlen=max(round(TARE_S * rate_hz), 1))
        self._zero = np.zeros(len(channels))
        self._lost = 0
        self._lost_before = 0  # right before the next sample; the reading thread's own
        self._running = False
        self._fault: DeviceFault | None = None
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._first = threading.Event()
        self._thread: threading.Thread | None = None

    def connect(self) -> None:
        """Open the line and wait for a first reading. Raises `DeviceAbsent`."""
        if self._thread is not None:
            return
        try:
            source = self._open()
        except OSError as error:  # unplugged while it is opened
            raise DeviceAbsent(self.name, f"lost while it was opened ({error})") from None
        self._fault, self._lost, self._lost_before = None, 0, 0
        self._zero = np.zeros(len(self.channels))
        self._recent.clear()
        self._waiting.clear()
        self._end = threading.Event()  # each thread has its own: a late one must not live on
        self._first.clear()
        self._thread = threading.Thread(
            target=self._follow, args=(source, self._end), name=f"palpate {self.name}", daemon=True
        )
        self._thread.start()
        wait_s = max(FIRST_S, 5 / self.rate_hz)
        answered = self._first.wait(wait_s)
        fault = self._fault
        if not answered or fault is not None:
            self.close()
            why = fault.reason if fault is not None else f"no reading within {wait_s:g} s"
            raise DeviceAbsent(self.name, why)

    def start(self) -> None:
        """Keep samples from now on. Raises `DeviceFault` if not connected."""
        self._check()
        with self._lock:
            self._waiting.clear()
            self._lost = 0
            self._running = True

    def read(self) -> Block:
        """All samples since the last call. Raises `DeviceFault` when closed or lost."""
        with self._lock:
            taken, lost = list(self._waiting), self._lost
            self._waiting.clear()
            self._lost = 0
        if not taken:
            self._check()
        raw = np.array([s.values for s in taken], dtype=float).reshape(-1, len(self.channels))
        times = np.array([s.time_s for s in taken])
        saturated = np.abs(raw) >= self._full_scale
        jumped_s = max((s.jumped_s for s in taken), default=0.0)
        lost += sum(s.lost for s in taken)
        return Block(times, raw - self._zero, saturated, lost, jumped_s)

    def tare(self) -> None:
        """The mean of the last tenth of a second becomes zero. Raises `DeviceFault` if stale."""
        self._check()
        with self._lock:
            recent = list(self._recent)
        age_s = self._clock.now() - recent[-1].time_s if recent else np.inf
        if age_s > max(0.5, 5 / self.rate_hz):
            raise DeviceFault(self.name, "no fresh reading to take as zero")
        newest_s = recent[-1].time_s
        self._zero = np.mean([s.values for s in recent if s.time_s > newest_s - TARE_S], axis=0)

    def stop(self) -> None:
        """Keep no more samples."""
        self._running = False

    def close(self) -> None:
        """End the thread, which closes the line."""
        self.stop()
        self._end.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=JOIN_S)
        self._waiting.clear()

    def _check(self) -> None:
        if self._fault is not None:
            raise self._fault
        if self._thread is None:
            raise DeviceFault(self.name, "not connected")

    def _follow(self, source: Source, end: threading.Event) -> None:
        try:
            while not end.is_set():
                for sample in source.read():
                    self._keep(sample)
        except (OSError, EOFError) as error:
            self._fault = DeviceFault(self.name, f"connection lost ({error})")
        except Exception as error:  # noqa: BLE001 - a dead reader must not look like a silent one
            self._fault = as_fault(self.name, error)
        finally:
            self._first.set()
            source.close()

    def _keep(self, sample: Sample) -> None:
        """A time or value that is not finite is a lost sample. Raises `DeviceFault`."""
        if len(sample.values) != len(self.channels):
            raise DeviceFault(
                self.name, f"driver: a reading of {len(sample.values)} values for "
                f"{len(self.channels)} channels"
            )  # fmt: skip
        if not (math.isfinite(sample.time_s) and all(map(math.isfinite, sample.values))):
            self._lost_before += 1 + sample.lost
            return
        if self._lost_before:
            sample = sample._replace(lost=sample.lost + self._lost_before)
            self._lost_before = 0
        with self._lock:
            self._recent.append(sample)
            if self._running:
                if len(self._waiting) >= self._limit:
                    self._lost += 1 + self._waiting.popleft().lost
                self._waiting.append(sample)
        self._first.set()
