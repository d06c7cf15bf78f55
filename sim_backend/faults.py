"""Devices that fail on purpose, at a given instant: to see that a scan survives them safely.

Each wraps a working device and behaves like it until the fault begins.
"""

from dataclasses import replace

import numpy as np

from drivers import Block, Channel, Clock, DeviceFault, Pose, Sensor, Stage

STAGE_FAULTS = ("stage lost", "stage refuses", "stage deaf", "stage runs on", "stage frozen")
SENSOR_FAULTS = (
    "sensor lost",
    "sensor silent",
    "sensor saturated",
    "sensor not a number",
    "sensor clock back",
    "sensor clock ahead",
)


class FaultyStage:
    """A stage that from ``at_s`` on is ``lost`` (raises), ``refuses`` moves, is ``deaf`` (accepts
    moves and stays), ``runs on`` (2 mm further down than told) or ``frozen`` (halts by itself).
    """

    def __init__(self, stage: Stage, clock: Clock, fault: str, at_s: float) -> None:
        self._stage, self._clock, self._fault, self._at_s = stage, clock, fault, at_s
        self.name = stage.name
        self.simulated = stage.simulated

    def connect(self) -> None:
        """As the working stage."""
        self._stage.connect()

    def pose(self) -> Pose:
        """As the working stage, unless lost."""
        if self._now("stage lost"):
            raise DeviceFault(self.name, "connection lost")
        if self._now("stage frozen"):
            self._stage.stop()
        return self._stage.pose()

    def move(self, target: Pose, speed_m_s: float) -> None:
        """As the working stage, unless it refuses, ignores or overdoes it."""
        if self._now("stage refuses") or self._now("stage lost"):
            raise DeviceFault(self.name, "move refused")
        if self._now("stage deaf"):
            return
        if self._now("stage runs on") and target.z < -1e-3:
            target = target._replace(z=target.z - 2e-3)
        self._stage.move(target, speed_m_s)

    def moving(self) -> bool:
        """As the working stage, unless lost."""
        if self._now("stage lost"):
            raise DeviceFault(self.name, "connection lost")
        return self._stage.moving()

    def stop(self) -> None:
        """Always works: a stop that fails is for the hardware's own emergency stop."""
        self._stage.stop()

    def close(self) -> None:
        """As the working stage."""
        self._stage.close()

    def _now(self, fault: str) -> bool:
        return self._fault == fault and self._clock.now() >= self._at_s


class FaultySensor:
    """A sensor that from ``at_s`` on is lost, silent, saturated, or tells nonsense."""

    def __init__(self, sensor: Sensor, clock: Clock, fault: str, at_s: float) -> None:
        self._sensor, self._clock, self._fault, self._at_s = sensor, clock, fault, at_s
        self.name = sensor.name
        self.rate_hz = sensor.rate_hz

    @property
    def channels(self) -> tuple[Channel, ...]:
        """As the working sensor."""
        return self._sensor.channels

    def connect(self) -> None:
        """As the working sensor."""
        self._sensor.connect()

    def start(self) -> None:
        """As the working sensor."""
        self._sensor.start()

    def read(self) -> Block:
        """As the working sensor, until the fault."""
        block = self._sensor.read()
        if self._clock.now() < self._at_s or not len(block.time_s):
            return block
        match self._fault:
            case "sensor lost":
                raise DeviceFault(self.name, "connection lost")
            case "sensor silent":
                return Block(block.time_s[:0], block.values[:0], block.saturated[:0])
            case "sensor saturated":
                return replace(block, saturated=np.ones_like(block.saturated))
            case "sensor not a number":
                return replace(block, values=np.full_like(block.values, np.nan))
            case "sensor clock back":
                return replace(block, time_s=block.time_s - 0.5)
            case "sensor clock ahead":
                return replace(block, time_s=block.time_s + 0.5)
        return block

    def tare(self) -> None:
        """As the working sensor."""
        self._sensor.tare()

    def stop(self) -> None:
        """As the working sensor."""
        self._sensor.stop()

    def close(self) -> None:
        """As the working sensor."""
        self._sensor.close()
