"""ATI Net F/T over Ethernet by ``pynetft``, which reads the box's own calibration by HTTP.

Records carry a sequence number: it counts what the network lost and is the device's time, at the
box's RDT output rate, which the rig file must give (``rate_hz``) and the driver checks.
"""

import math
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from drivers.core.errors import DeviceAbsent, DeviceFault
from drivers.core.extras import needs
from drivers.core.protocols import Channel, Clock
from drivers.core.reader import LineSensor, Sample
from drivers.core.settings import NonNegative, Positive
from drivers.core.timestamps import DeviceTime
from drivers.core.units import SI

if TYPE_CHECKING:
    import pynetft

SILENCE_S = 0.1  # a hundred records at 1000 Hz
CHECK_S = 0.5
RATE_SLACK = 0.03
QUEUE = 20_000  # in the library, before our thread gets them
ORDER_FAULTS = ("ft_stall", "ft_backward")
DISORDERS, DISORDERS_S = 10, 1.0  # each costs a few readings: more would be no scan
AXES = ("fx", "fy", "fz", "mx", "my", "mz")
Normal = Literal["+fx", "-fx", "+fy", "-fy", "+fz", "-fz"]


class RateCheck:
    """Whether records come at ``rate_hz``: those of another rate come ever later, or earlier.

    A machine that stands still delays some, so the one least late in each `CHECK_S` is compared
    with the time before. What it delayed comes late once, and then sooner again, but no sooner
    than ever: another rate goes on in the same direction.
    """

    def __init__(self, rate_hz: float, began_s: float) -> None:
        self._rate_hz = rate_hz
        self._since_s = began_s
        self._lateness_s = math.inf  # the least since then
        self._before_s: float | None = None  # the least of the time before
        self._ever_s = math.inf
        self._trend = 0

    def other_hz(self, count: int, arrival_s: float) -> float | None:
        """The rate at which the box sends, once it is seen to be another."""
        self._lateness_s = min(self._lateness_s, arrival_s - count / self._rate_hz)
        if (passed_s := arrival_s - self._since_s) < CHECK_S:
            return None
        now_s, before_s, ever_s = self._lateness_s, self._before_s, self._ever_s
        self._since_s, self._lateness_s = arrival_s, math.inf
        self._before_s, self._ever_s = now_s, min(now_s, ever_s)
        if before_s is None:
            return None
        slack_s, trend = RATE_SLACK * passed_s, self._trend
        self._trend = (now_s > before_s + slack_s) - (now_s < ever_s - slack_s)
        if self._trend == 0 or self._trend != trend:
            return None
        return max(self._rate_hz * (1 - (now_s - before_s) / passed_s), 0.0)


class RdtSource:
    """A running client; see `drivers.core.reader.Source`. Raises `DeviceAbsent`."""

    def __init__(
        self,
        clock: Clock,
        name: str,
        config: "pynetft.Config",
        rate_hz: float,
        normal: Normal,
        latency_s: float,
    ) -> None:
        self._clock = clock
        self._name = name
        self._config = config
        self._rate_hz = rate_hz
        self._sign = 1.0 if normal[0] == "+" else -1.0
        self._axis = AXES.index(normal[1:])
        self._time = DeviceTime(latency_s)
        self._client: pynetft.Client
        self._samples: Iterator[pynetft.Sample]
        self._last: int | None = None
        self._count = 0
        self._rate = RateCheck(rate_hz, clock.now())
        self._arrival_s = clock.now()
        self._disorders: deque[float] = deque(maxlen=DISORDERS)
        try:
            self._begin()
        except DeviceFault as fault:
            raise DeviceAbsent(
                name, f"no Net F/T box at {config.sensor_host}, TCP {config.http_port} (http_port):"
                f" {fault.reason}"
            ) from None  # fmt: skip

    def read(self) -> list[Sample]:
        """The next record. Raises `DeviceFault` on the box's own faults."""
        import pynetft

        try:
            got = next(self._samples)
        except TimeoutError:
            self._samples = self._client.samples(timeout=0.05)
            return []
        except StopIteration:
            raise DeviceFault(self._name, "the stream has ended") from None
        except pynetft.SensorFaultError as error:
            if error.fault_code.value not in ORDER_FAULTS:
                config, hint = self._config, ""
                if self._count == 0:
                    hint = (f"; is the box at {config.sensor_host} on? UDP {config.rdt_port} "
                            "(rdt_port) is asked for records")  # fmt: skip
                elif error.fault_code.value == "timeout":
                    hint = "; or another program has asked the box, which sends to one only"
                raise DeviceFault(self._name, _in_words(error) + hint) from None
            self._begin_anew(error.health.sensor_configuration)
            return []
        received_s = 1e-9 * (time.monotonic_ns() - got.received_at_ns)
        arrival_s = self._clock.now() - received_s
        if self._last is None:  # begun, or begun anew: the box counts from 1 again
            step = max(round((arrival_s - self._arrival_s) * self._rate_hz), 1)
        else:
            step = (got.rdt_sequence - self._last) % 2**32
        self._last, self._arrival_s = got.rdt_sequence, arrival_s
        if not 0 < step < 2**31:  # repeated or out of order
            return []
        self._count += step
        if (sent_hz := self._rate.other_hz(self._count, arrival_s)) is not None:
            raise DeviceFault(
                self._name, f"sends {sent_hz:.0f} records a second; rate_hz = {self._rate_hz:g}"
            )
        time_s = self._time.stamp(self._count / self._rate_hz, arrival_s)
        force, torque = SI[got.force_unit.value][1], SI[got.torque_unit.value][1]
        values = [force * v for v in got.force] + [torque * v for v in got.torque]
        return [Sample(time_s, [self._sign * values[self._axis], *values], step - 1)]

    def close(self) -> None:
        """End the stream."""
        self._client.stop()

    def _begin(self) -> None:
        """Start a client and its stream. Raises `DeviceFault`."""
        import pynetft

        self._client = pynetft.Client(self._config, queue_size=QUEUE)
        try:
            self._client.start()
        except (pynetft.NetFTError, OSError) as error:
            raise DeviceFault(self._name, f"connection lost ({error})") from None
        self._samples = self._client.samples(timeout=0.05)
        self._last = None

    def _begin_anew(self, known: "pynetft.SensorConfiguration | None") -> None:
        """A record came twice or was overtaken on the network, where the library ends its stream.

        The calibration is ``known``: its page would cost the box, whose web server is slow, records
        that nobody reads. Raises `DeviceFault` if that goes on.
        """
        now_s = self._clock.now()
        self._disorders.append(now_s)
        if len(self._disorders) == DISORDERS and now_s - self._disorders[0] < DISORDERS_S:
            raise DeviceFault(
                self._name, f"records come twice or out of order, {DISORDERS} times in "
                f"{DISORDERS_S:g} s: use a cable without other traffic"
            )  # fmt: skip
        self._client.stop()
        if known is not None:
            self._config = replace(self._config, calibration_override=known.calibration)
        self._begin()


def _in_words(fault: "pynetft.SensorFaultError") -> str:
    words = fault.fault_code.value.replace("_", " ")
    return f"{words} ({fault.health.last_error})" if fault.health.last_error else words


def open_sensor(
    clock: Clock,
    *,
    host: str = "192.168.1.1",
    rate_hz: Positive = 1000.0,
    normal: Normal = "-fz",
    latency_ms: NonNegative = 0.0,
    silence_s: Positive = SILENCE_S,
    rdt_port: int = 49152,
    http_port: int = 80,
    name: str = "netft",
    simulated: bool = False,
) -> LineSensor:
    """A Net F/T box at ``host`` that sends ``rate_hz`` records a second (RDT output rate).

    The channel ``force`` is the axis ``normal``, positive when pressed. ``silence_s`` without a
    record is a fault. Raises `MissingExtra`.
    """
    with needs("netft", 'driver = "netft"'):
        import pynetft
    channels = (
        Channel("force", "N", "force"),
        *(Channel(axis, "N") for axis in AXES[:3]),
        *(Channel(axis, "Nm") for axis in AXES[3:]),
    )

    def open_source() -> RdtSource:
        config = pynetft.Config(
            sensor_host=host,
            rdt_port=rdt_port,
            http_port=http_port,
            receive_timeout=silence_s,
            recovery_policy=pynetft.RecoveryPolicy.FAIL_STOP,
        )
        return RdtSource(clock, name, config, rate_hz, normal, 1e-3 * latency_ms)

    return LineSensor(clock, name, channels, rate_hz, open_source, simulated=simulated)
