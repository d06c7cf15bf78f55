"""What some stages can do beyond the protocol, asked only of those; see `drivers.Stage`."""

import math
from collections.abc import Sequence

from drivers.core.protocols import Pose, Stage


def enable(stage: Stage) -> list[str]:
    """Have it ready to move; what then holds, in words. Raises `DeviceFault`."""
    own = getattr(stage, "enable", None)
    return [] if own is None else list(own())


def enable_s(stage: Stage) -> float:
    """How long `enable` may take, where the rig file says so; 0 if the stage does not say."""
    return float(getattr(stage, "enable_s", 0.0))


def keep_alive(stage: Stage) -> None:
    """Tell a stage with a watchdog that somebody has just checked the force."""
    if (own := getattr(stage, "keep_alive", None)) is not None:
        own()


def start_again(stage: Stage) -> None:
    """Have a stage ready again that has halted by its watchdog. Raises `DeviceFault`."""
    if (own := getattr(stage, "start_again", None)) is not None:
        own()


def finds_contact(stage: Stage) -> bool:
    """Whether it may itself end a move at a contact."""
    return bool(getattr(stage, "finds_contact", False))


def move(stage: Stage, target: Pose, speed_m_s: float, *, search: bool) -> None:
    """Set off; one that finds contact by itself ends a ``search`` there. As `Stage.move`."""
    own = getattr(stage, "search", None) if search and finds_contact(stage) else None
    (own or stage.move)(target, speed_m_s)


def touched(stage: Stage) -> bool:
    """Whether it has itself ended the last search at a contact."""
    return bool(getattr(stage, "touched", False))


def pace(stage: Stage) -> float:
    """The share of a commanded speed that it allows now; 1 if it does not say."""
    return float(getattr(stage, "pace", 1.0))


def max_speed_m_s(stage: Stage) -> float:
    """The speed above which it refuses a move; infinite if it does not say."""
    return float(getattr(stage, "max_speed_m_s", math.inf))


def unreachable(stage: Stage, poses: Sequence[Pose]) -> dict[Pose, str]:
    """Those of ``poses`` that it cannot go to as far as it knows, and why. Raises `DeviceFault`."""
    own = getattr(stage, "unreachable", None)
    return {} if own is None else dict(own(poses))
