"""A force gauge that streams lines `MILLISECONDS NEWTONS*CHECKSUM`: change what is yours.

Install it with `pip install -e .`; hold it to the contract, without the device, with
`pytest --palpate-driver=my_gauge --palpate-bench=my_bench:bench`. How a gauge that answers when it
is asked is read stands in docs/how-to/add-a-driver.md.
"""

from drivers import Channel, Clock
from drivers.core.ports import open_port, read_some
from drivers.core.reader import LineSensor, Sample
from drivers.core.timestamps import DeviceTime


class Stream:
    """The open line; only the reader's own thread uses it."""

    def __init__(self, clock: Clock, port: str, rate_hz: float, latency_s: float) -> None:
        self.clock = clock
        self.line = open_port("my_gauge", port, baud=115200)
        # Lines arrive in bursts; the gauge's own milliseconds say when each was measured.
        self.time = DeviceTime(latency_s)
        self.period_s = 1 / rate_hz
        self.last_s: float | None = None
        self.rest = b""

    def read(self) -> list[Sample]:
        """What has arrived; an empty list if nothing came. Raises `OSError` if the line is lost."""
        self.rest += read_some(self.line)
        arrived_s = self.clock.now()
        *lines, self.rest = self.rest.split(b"\n")
        return [sample for line in lines if (sample := self.sample(line, arrived_s))]

    def sample(self, line: bytes, arrived_s: float) -> Sample | None:
        """One line as a sample in SI, or None for a damaged one: never a number not trusted."""
        body, _, check = line.strip().partition(b"*")
        if b"%02X" % (sum(body) % 256) != check:
            return None
        milliseconds, newtons = body.split()
        device_s = 1e-3 * float(milliseconds)
        missing = 0
        if self.last_s is not None and device_s > self.last_s:  # else the gauge began anew
            missing = max(round((device_s - self.last_s) / self.period_s) - 1, 0)
        self.last_s = device_s
        return Sample(self.time.stamp(device_s, arrived_s), [float(newtons)], missing)

    def close(self) -> None:
        """Release the line."""
        self.line.close()


def open_sensor(
    clock: Clock, *, port: str, rate_hz: float = 100.0, latency_ms: float = 0.0
) -> LineSensor:
    """The keys of its table in a rig file; palpate checks them against these annotations."""
    force = Channel("force", "N", role="force", full_scale=10.0)
    return LineSensor(
        clock, "my_gauge", (force,), rate_hz,
        lambda: Stream(clock, port, rate_hz, 1e-3 * latency_ms),
    )  # fmt: skip
