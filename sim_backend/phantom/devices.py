"""A simulated stage and a simulated sensor, with its noise, in one phantom.

The default sensor is a good laboratory load cell: 0.5 mN rms at 500 Hz, 0.1 mN steps, 10 N full
scale. A Robotiq FT300 would be ``rate_hz = 100, noise_mn = 100, quantum_mn = 10``.
"""

import math
from typing import Protocol
from zlib import crc32

import numpy as np

from drivers import Block, Channel, Clock, ConfigError, DeviceFault, Pose, Stage
from drivers.core.protocols import MAX_RATE_HZ
from drivers.core.settings import NonNegative, Positive
from drivers.core.stage_limits import Limits, check_speed, check_target
from sim_backend.arrays import Array, Bools, Ints
from sim_backend.phantom.array import Taxels, VirtualArray
from sim_backend.phantom.load_cell import LoadCell
from sim_backend.phantom.phantom import Phantom

AHEAD_S = 0.25  # samples are computed this far ahead; a new command discards what it changes
TARE_S = 0.1  # a tare is the mean over this long
NOISE_CHUNK = 4096
KEYS = tuple(f"array.{key}" for key in VirtualArray.model_fields)
WIDE: Limits = ((-500.0, 500.0), (-500.0, 500.0), (-100.0, 500.0))


class VirtualStage:
    """A stage without inertia but with a bounded speed and acceleration."""

    simulated = True

    def __init__(
        self,
        clock: Clock,
        phantom: Phantom,
        limits_mm: Limits,
        max_speed_m_s: float,
        acceleration: float,
    ) -> None:
        self.name = "virtual"
        self._clock = clock
        self._tip = phantom.tip
        self.limits_mm = limits_mm
        self.max_speed_m_s = max_speed_m_s
        self._acceleration = acceleration

    def connect(self) -> None:
        """Nothing to open."""

    def pose(self) -> Pose:
        """Where the tip is now."""
        return Pose(*self._tip.point(self._clock.now()))

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off. Raises `DeviceFault` outside the limits, when too fast or still moving."""
        if self.moving():
            raise DeviceFault(self.name, "still moving; wait or stop before the next move")
        check_speed(self.name, 1e3 * self.max_speed_m_s, speed_m_s)
        check_target(self.name, self.limits_mm, target)
        self._tip.move(self._clock.now(), target[:3], speed_m_s, self._acceleration)

    def moving(self) -> bool:
        """True until the last move has ended."""
        return self._tip.moving(self._clock.now())

    def stop(self) -> None:
        """Slow down at the stage's acceleration."""
        self._tip.halt(self._clock.now(), self._acceleration)

    def close(self) -> None:
        """Stop."""
        self.stop()


class Feeling(Protocol):
    """What a sensor is made of: `LoadCell`, `Taxels`. ``noise`` (m,) is that of the first m
    channels, the ones that a device measures: they are noisy and can be tared."""

    @property
    def channels(self) -> tuple[Channel, ...]: ...
    @property
    def noise(self) -> Array: ...
    def read(self, time_s: Array, since_start_s: Array, noise: Array) -> tuple[Array, Bools]: ...


class VirtualSensor:
    """A sensor on the phantom's tip: what is ``felt`` a latency ago, less the tare.

    Noise belongs to the sample's index, so a seed gives the same bytes however the samples are
    read.
    """

    def __init__(
        self,
        clock: Clock,
        phantom: Phantom,
        felt: Feeling,
        *,
        name: str,
        rate_hz: float,
        latency_s: float,
        seed: int,
        follow: Stage | None,
    ) -> None:
        self.name = name
        self.rate_hz = rate_hz
        self.channels = felt.channels
        self._clock = clock
        self._phantom = phantom
        self._felt = felt
        self._latency_s = latency_s
        self._key = (seed, crc32(name.encode()))
        self._follow = follow
        self._chunk: tuple[int, Array] = (-1, np.empty(0))
        self._zero = np.zeros(len(self.channels))
        self._running = False
        self._first = self._next = 1
        self._begin(clock.now())

    def connect(self) -> None:
        """Nothing to open."""

    def start(self) -> None:
        """Sample from now on; the first sample is taken one period later."""
        self._begin(self._clock.now())
        self._running = True

    def read(self) -> Block:
        """All samples due since the last call."""
        now = self._clock.now()
        if self._follow is not None:
            self._phantom.tip.record(now, self._follow.pose()[:3])
        due = math.floor((now - self._start_s) * self.rate_hz + 1e-6) if self._running else 0
        end = max(due + 1, self._next)
        self._compute_to(end)
        part = slice(self._next - self._first, end - self._first)
        self._next = end
        values = self._values[part] - self._zero
        return Block(self._times[part], values, self._saturated[part])

    def tare(self) -> None:
        """The mean of the last tenth of a second becomes zero."""
        newest = self._next - self._first
        recent = self._values[max(newest - round(TARE_S * self.rate_hz), 0) : newest]
        if len(recent):
            measured = len(self._felt.noise)
            self._zero[:measured] = recent[:, :measured].mean(axis=0)

    def stop(self) -> None:
        """End sampling."""
        self._running = False

    def close(self) -> None:
        """Stop."""
        self.stop()

    def _begin(self, start_s: float) -> None:
        self._start_s = start_s
        self._first = 1  # index of the first sample kept
        self._next = 1  # index of the next sample to hand out
        self._revision = self._phantom.tip.revision
        self._times: Array = np.empty(0)
        self._values: Array = np.empty((0, len(self.channels)))
        self._saturated: Bools = np.empty((0, len(self.channels)), dtype=bool)

    def _compute_to(self, end: int) -> None:
        """Have samples up to index ``end`` (exclusive), valid for the tip's present course."""
        tip = self._phantom.tip
        have = self._first + len(self._times)
        if tip.revision != self._revision:
            self._revision = tip.revision
            valid = np.searchsorted(self._times, tip.changed_s + self._latency_s)
            have = self._first + int(valid)
        if end <= have == self._first + len(self._times):
            return
        ahead = 0 if self._follow is not None else round(AHEAD_S * self.rate_hz)
        keep_from = max(self._next - round(TARE_S * self.rate_hz) - 1, self._first)
        kept = slice(keep_from - self._first, have - self._first)
        times, values, saturated = self._sample(np.arange(have, max(end, have) + ahead))
        self._times = np.concatenate([self._times[kept], times])
        self._values = np.concatenate([self._values[kept], values])
        self._saturated = np.concatenate([self._saturated[kept], saturated])
        self._first = keep_from

    def _sample(self, index: Ints) -> tuple[Array, Array, Bools]:
        time_s = self._start_s + index / self.rate_hz
        read, saturated = self._felt.read(
            time_s - self._latency_s, time_s - self._start_s, self._noise(index)
        )
        return time_s, read, saturated

    def _noise(self, index: Ints) -> Array:
        """Noise (n, m) of the samples of these ascending numbers (n,)."""
        deviation = self._felt.noise
        noise = np.zeros((len(index), len(deviation)))
        if not deviation.any():
            return noise
        chunks, offsets = np.divmod(index, NOISE_CHUNK)
        for chunk in range(chunks[0], chunks[-1] + 1):
            if chunk != self._chunk[0]:
                rng = np.random.default_rng([*self._key, chunk])
                drawn = rng.standard_normal((NOISE_CHUNK, len(deviation)))
                self._chunk = (chunk, deviation * drawn)
            here = chunks == chunk
            noise[here] = self._chunk[1][offsets[here]]
        return noise


def virtual_stage(
    clock: Clock,
    *,
    phantom: Phantom,
    limits_mm: Limits = WIDE,
    max_speed_mm_s: Positive = 50.0,
    acceleration_mm_s2: Positive = 1000.0,
    stiffness_n_mm: Positive | None = None,
) -> VirtualStage:
    """A stage in the phantom; the defaults are a small laboratory gantry's, and a rigid one.

    With ``stiffness_n_mm`` the rig gives way: the tip is less deep than the stage reports.
    """
    if stiffness_n_mm is not None:
        phantom.stiffness_n_m = 1e3 * stiffness_n_mm
    return VirtualStage(clock, phantom, limits_mm, 1e-3 * max_speed_mm_s, 1e-3 * acceleration_mm_s2)


def virtual_sensor(
    clock: Clock,
    *,
    phantom: Phantom,
    name: str | None = None,
    rate_hz: Positive = 500.0,
    noise_mn: NonNegative = 0.5,
    quantum_mn: NonNegative = 0.1,
    full_scale_n: Positive = 10.0,
    gain: Positive = 1.0,
    bias_mn: float = 0.0,
    drift_mn_s: float = 0.0,
    latency_ms: NonNegative = 0.0,
    seed: int = 0,
    follow: Stage | None = None,
    array: VirtualArray | None = None,
) -> VirtualSensor:
    """A force sensor in the phantom, or an array of taxels.

    ``gain``: newtons read per newton. ``follow``: a real stage whose reported pose carries the
    phantom's tip. ``array``: taxels take the load cell's place; its keys may not be given then.
    ``name``: ``force``, or ``taxels``. Raises `ConfigError` for a rate above `MAX_RATE_HZ`.
    """
    if rate_hz > MAX_RATE_HZ:
        raise ConfigError(f"rate_hz = {rate_hz:g}: must be at most {MAX_RATE_HZ:g}")
    name = name or ("force" if array is None else "taxels")
    if array is None:
        felt: Feeling = LoadCell(
            phantom, 1e-3 * noise_mn, 1e-3 * quantum_mn, full_scale_n, gain, 1e-3 * bias_mn,
            1e-3 * drift_mn_s,
        )  # fmt: skip
    else:
        usual = virtual_sensor.__kwdefaults__ or {}
        own = {"noise_mn": noise_mn, "quantum_mn": quantum_mn, "full_scale_n": full_scale_n,
               "gain": gain, "bias_mn": bias_mn, "drift_mn_s": drift_mn_s}  # fmt: skip
        for key, value in own.items():
            if value != usual[key]:
                raise ConfigError(
                    f"{key} = {value:g}: is a load cell's key; an array's are {', '.join(KEYS)}"
                )
        felt = Taxels(phantom, array, name, seed)
    return VirtualSensor(
        clock, phantom, felt, name=name, rate_hz=rate_hz, latency_s=1e-3 * latency_ms, seed=seed,
        follow=follow,
    )  # fmt: skip
