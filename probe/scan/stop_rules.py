"""When a scan ends before its last station, or a press is broken off: one function a rule.

A rule looks at what is `Seen` at every tick and returns the `Interrupted` to raise, or None. The
first of `RULES` that objects decides. Rules that need the levels of a hold follow below. The limits
that a guard enforces without the engine are not here but in `force_limit` and `pose_guard`; their
objection arrives as the ``trip``. How long a hold lasts is `engine`'s, by the plan.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from probe.core.events import Finish, Phase
from probe.guards.commands import STOPPED, RunCommand
from probe.guards.interruption import Interrupted, Trip, interruption_of
from probe.guards.levels import Levels, no_force

ABORTED = "aborted by the user"


class Seen(NamedTuple):
    """What the rules judge: the user's command, a guard's trip, the store, the phase."""

    command: RunCommand
    trip: Trip | None
    sink_error: str | None
    phase: Phase


Rule = Callable[[Seen], Interrupted | None]


def user_stopped(seen: Seen) -> Interrupted | None:
    """Stop: end at once, and stay where the probe is."""
    if seen.command is not RunCommand.STOP:
        return None
    return Interrupted(Finish.ABORTED, STOPPED, "user", retract=False)


def guard_tripped(seen: Seen) -> Interrupted | None:
    """A guard has stopped the stage already."""
    return None if seen.trip is None else interruption_of(seen.trip)


def store_failed(seen: Seen) -> Interrupted | None:
    """What cannot be stored is not measured."""
    if seen.sink_error is None:
        return None
    return Interrupted(Finish.FAULTED, seen.sink_error, "store", retract=True)


def user_aborted(seen: Seen) -> Interrupted | None:
    """Abort: lift, then end."""
    if seen.command is not RunCommand.ABORT:
        return None
    return Interrupted(Finish.ABORTED, ABORTED, "user", retract=True)


def user_paused(seen: Seen) -> Interrupted | None:
    """Pause: lift and wait; the press is made again."""
    if seen.command is not RunCommand.PAUSE_NOW or seen.phase is Phase.PAUSED:
        return None
    return Interrupted(None, "paused by the user", "user", retract=True)


RULES: tuple[Rule, ...] = (user_stopped, guard_tripped, store_failed, user_aborted, user_paused)


def interrupted(seen: Seen) -> Interrupted | None:
    """The first rule's objection; None while the scan may go on."""
    for rule in RULES:
        if (why := rule(seen)) is not None:
            return why
    return None


def no_contact(
    levels: Levels, rates_hz: Mapping[str, float], most_n: float, indentation_m: float
) -> Interrupted | None:
    """In a hold: a probe that feels nothing that deep has not met the tissue."""
    if (why := no_force(levels, rates_hz, most_n)) is None:
        return None
    reason = f"{why} {1e3 * indentation_m:g} mm deep: the surface is lower than planned, or the "
    return Interrupted(
        Finish.FAULTED, reason + "sensor does not measure force", "engine", retract=True
    )
