"""What some stages can do beyond the protocol, asked only of those; see `drivers.Stage`."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.core.protocols import Pose, Stage
from drivers.core.stage_limits import Limits, outside


@dataclass(frozen=True)
class StopMeans:
    """One of the ways in which a stage can be stopped.

    A stop is what is seen: the poses that the stage reports come to rest. A means that was ordered
    and is not seen to work in its time is followed by the next one in the table.

    Attributes
    ----------
    name : str
        What a person reads of it, in the words of the device's manual: ``"jog cancel (0x85)"``.
    call : callable
        Gives the order and returns at once. Idempotent, from any thread at any time, never raises:
        it is repeated every 20 ms until the tip rests.
    within_s : float
        From the first order to the first pose of a tip at rest, at the latest: what the line and
        the controller need, the age of a pose, and the fastest allowed speed divided by the
        deceleration. The guards add what they need to see that it rests.
    lifts : bool
        Whether the stage can be moved by the program afterwards, if need be after `start_again`.
        A means without a lift is taken only for a tip that is *seen* to go on, or as the last
        thing before the way out is given up; one with a lift also where no pose comes.

    Examples
    --------
    >>> from drivers.core.abilities import StopMeans
    >>> def hold() -> None: ...
    >>> def reset() -> None: ...
    >>> table = StopMeans("hold (!)", hold, 0.2), StopMeans("reset (0x18)", reset, 0.1, lifts=False)
    """

    name: str
    call: Callable[[], None]
    within_s: float
    lifts: bool = True


def stop_means(stage: Stage) -> tuple[StopMeans, ...]:
    """Its ways to stop, the mildest first; its `Stage.stop` alone if it does not say."""
    if (own := getattr(stage, "stop_means", None)) is not None:
        return tuple(own())
    return (StopMeans("stop", stage.stop, math.inf),)


def turns(stage: Stage) -> bool:
    """Whether it can turn the probe."""
    return bool(getattr(stage, "turns", False))


def homes(stage: Stage) -> bool:
    """Whether it must find its switches before it can be used."""
    return bool(getattr(stage, "homes", False))


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


def lift_when_alone(stage: Stage, z_m: float, speed_m_s: float) -> None:
    """Tell a stage that can lift without this process how high: see `Stage`."""
    if (own := getattr(stage, "lift_when_alone", None)) is not None:
        own(z_m, speed_m_s)


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


def why_still(stage: Stage) -> str | None:
    """What holds a move up now, in the device's own words; None if it does not say.

    Raises `DeviceFault`.
    """
    if (own := getattr(stage, "why_still", None)) is not None:
        return None if (why := own()) is None else str(why)
    return None if (now := pace(stage)) >= 1 else f"it allows {100 * now:.3g} % of a speed"


def max_speed_m_s(stage: Stage) -> float:
    """The speed above which it refuses a move; infinite if it does not say."""
    return float(getattr(stage, "max_speed_m_s", math.inf))


def limits_mm(stage: Stage) -> Limits | None:
    """Bounds of its own targets; None if it does not say."""
    own: Limits | None = getattr(stage, "limits_mm", None)
    return own


def beyond_limits(stage: Stage, poses: Sequence[Pose]) -> dict[Pose, str]:
    """Those of ``poses`` that its key ``limits_mm`` forbids, and why; the device is not asked."""
    if (own := getattr(stage, "beyond_limits", None)) is not None:
        return dict(own(poses))
    why = {pose: outside(limits_mm(stage), pose) for pose in poses}
    return {pose: words for pose, words in why.items() if words is not None}


def park(stage: Stage) -> Pose | None:
    """Where it goes once it has found its switches; None if it stays there, or does not home."""
    park_mm = getattr(stage, "park_mm", None) if homes(stage) else None
    return None if park_mm is None else Pose(*(1e-3 * at for at in park_mm))


def unreachable(stage: Stage, poses: Sequence[Pose]) -> dict[Pose, str]:
    """Those of ``poses`` that it cannot go to as far as it knows, and why. Raises `DeviceFault`."""
    own = getattr(stage, "unreachable", None)
    return {} if own is None else dict(own(poses))
