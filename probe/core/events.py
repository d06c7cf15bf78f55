"""The events of a running scan: the only output of the engine.

The run file, the live view, the progress bar and a replay all see these and nothing else.
Times are seconds on the scan's clock.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from drivers import Block, Channel


class Phase(StrEnum):
    """What the probe is doing; the states of the scan's state machine."""

    IDLE = "idle"
    CONNECTING = "connecting"
    HOMING = "homing"
    TARING = "taring"
    TRAVELLING = "travelling"
    APPROACHING = "approaching"
    INDENTING = "indenting"
    HOLDING = "holding"
    RETRACTING = "retracting"
    PAUSED = "paused"
    STOPPING = "stopping"
    FINISHED = "finished"


class Finish(StrEnum):
    """How a run ended."""

    COMPLETED = "completed"
    ABORTED = "aborted"
    FAULTED = "faulted"


@dataclass(frozen=True)
class RunStarted:
    """All that is needed to know what the samples mean.

    ``config`` is JSON-able: ``rig``, ``scene`` (or None), ``plan``, ``calibration``, ``versions``,
    ``seed``, ``face_mm2``. ``channels`` maps each device to its channels; the device ``stage``
    has channels x, y, z in m.
    """

    time_s: float
    started_utc: str
    config: Mapping[str, Any]
    channels: Mapping[str, tuple[Channel, ...]]


@dataclass(frozen=True)
class StationStarted:
    """The probe sets off to station ``station`` (0-based); ``attempt`` counts from 1."""

    time_s: float
    station: int
    attempt: int
    x_m: float
    y_m: float


@dataclass(frozen=True)
class PhaseEntered:
    """The probe entered ``phase``; ``station`` is None between stations."""

    time_s: float
    phase: Phase
    station: int | None


@dataclass(frozen=True)
class Samples:
    """What ``device`` read; ``station`` and ``attempt`` are None between stations."""

    device: str
    block: Block
    station: int | None
    attempt: int | None


@dataclass(frozen=True)
class StationEnded:
    """``complete`` only if the whole press was made and every sample of it is in."""

    time_s: float
    station: int
    attempt: int
    complete: bool


@dataclass(frozen=True)
class Note:
    """Something a person should know; ``level`` is ``info``, ``warning`` or ``fault``."""

    time_s: float
    level: str
    device: str
    text: str

    @property
    def words(self) -> str:
        """The text with its device before it, once."""
        return (
            self.text if self.text.startswith(f"{self.device}:") else f"{self.device}: {self.text}"
        )


@dataclass(frozen=True)
class RunEnded:
    """The last event of a run."""

    time_s: float
    finish: Finish
    reason: str


Event = RunStarted | StationStarted | PhaseEntered | Samples | StationEnded | Note | RunEnded
