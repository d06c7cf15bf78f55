"""What the engine sees of devices, of a way out and of a homing in the guards' process."""

import time
from typing import Any, Protocol

from drivers import Block, Pose
from probe.guards.guard_process import Facts, Leaving, SensorFacts, Status

POSE_S = 0.5  # an arm's driver gives its controller 0.3 s for the questions about one pose


class Line(Protocol):
    """What is asked of the other process: see `probe.guards.guard_client.GuardClient`."""

    def call(self, name: str, *arguments: Any, extra_s: float = 0.0) -> Any: ...
    def status(self) -> Status: ...
    def engine_heartbeat(self) -> None: ...
    def stop(self) -> None: ...
    def stay(self) -> None: ...


class RemoteStage:
    """What the engine knows of a stage in the other process: it moves by the monitor only."""

    def __init__(self, facts: Facts, client: Line) -> None:
        self.name, self.simulated = facts.stage, facts.simulated
        self.turns, self.homes = facts.turns, facts.homes
        self._enable_s, self._client = facts.enable_s, client

    @property
    def pace(self) -> float:
        """As `drivers.core.abilities.pace`."""
        return self._client.status().pace

    def enable(self) -> list[str]:
        """As `drivers.core.abilities.enable`."""
        return list(self._client.call("enable", extra_s=self._enable_s))

    def unreachable(self, poses: list[Pose]) -> dict[Pose, str]:
        """As `drivers.core.abilities.unreachable`."""
        return dict(self._client.call("unreachable", poses, extra_s=POSE_S * len(poses)))

    def stop(self) -> None:
        """Past all calls that wait for an answer."""
        self._client.stop()

    def connect(self) -> None:
        """It is."""

    def pose(self) -> Pose:
        """Only by the monitor."""
        raise NotImplementedError

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Only by the monitor."""
        raise NotImplementedError

    def moving(self) -> bool:
        """Only by the monitor."""
        raise NotImplementedError

    def close(self) -> None:
        """With the other process."""


class RemoteSensor:
    """What the engine knows of a sensor in the other process: the monitor reads it."""

    def __init__(self, facts: SensorFacts) -> None:
        self.name, self.channels, self.rate_hz = facts.name, facts.channels, facts.rate_hz

    def connect(self) -> None:
        """It is."""

    def start(self) -> None:
        """With the monitor."""

    def read(self) -> Block:
        """Only by the monitor."""
        raise NotImplementedError

    def tare(self) -> None:
        """Only by the monitor."""
        raise NotImplementedError

    def stop(self) -> None:
        """With the monitor."""

    def close(self) -> None:
        """With the other process."""


class RemoteRetreat:
    """The way out in the other process: what `Leaving` says, as of the last heartbeat."""

    def __init__(self, client: Line) -> None:
        self._client = client

    def __getattr__(self, name: str) -> Any:
        return getattr(self._client.status().leaving or Leaving(), name)

    def stay(self) -> None:
        """Do not lift (any more)."""
        self._client.stay()


class RemoteHoming:
    """The homing in the other process, as of the last heartbeat."""

    def __init__(self, client: Line) -> None:
        self._client = client

    def is_set(self) -> bool:
        """It is over."""
        return self._client.status().homed

    def wait(self, seconds: float) -> None:
        """Let it go on, and look."""
        time.sleep(seconds)
        self._client.engine_heartbeat()
