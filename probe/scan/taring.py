"""The zero of a press: the load in the air just before it, seen to be the air and at rest."""

import math

from drivers import DeviceFault, Pose
from probe.core.events import Finish
from probe.guards.interruption import Interrupted
from probe.guards.levels import LEVEL_S, MAX_LEVEL_S, MAX_UNSTEADY_S, Levels, changed, unknown
from probe.planning.plan import AWAY_M
from probe.scan.run_loop import RunLoop

NOTED_SHARE = 0.5  # of the drift that a tare asks about (`levels.MAX_HIDDEN_SHARE`) is noted
ROUNDING_M = 1e-9  # of a height: 12.5 mm and 0.5 mm are a last digit less than 13


def take_zero(loop: RunLoop, above: Pose) -> None:
    """Take the load in the air as zero, and see that it is the air.

    The load at the first tare, and wherever it is another than when it was last looked at,
    must not change when the probe moves away. Else the probe presses on something, and a tare
    would hide that from the limit.
    """
    near = _levels(loop)
    _note_drift(loop, near)
    if loop.known_levels is None or changed(near, loop.known_levels, loop.most_n):
        away = loop.plan.away(above, loop.top_m)
        if (room_m := away.z - above.z) < AWAY_M - ROUNDING_M:
            short = loop.plan.clearance_m < AWAY_M - ROUNDING_M
            raise Interrupted(
                Finish.FAULTED,
                f"{'safety.retract_mm' if short else 'safety.workspace_mm.z'} lets the probe rise "
                f"{1e3 * room_m:g} mm over the place of the tare; {1e3 * AWAY_M:g} mm are needed "
                "to see that it is in the air",
                "engine", retract=True,
            )  # fmt: skip
        loop.go(away, loop.plan.travel_m_s)
        far = _levels(loop)
        if (why := changed(near, far, loop.most_n)) is not None:
            reason = f"{why} on moving {1e3 * (away.z - above.z):g} mm away from the tissue: "
            reason += "the probe presses on something where the force is taken as zero"
            raise Interrupted(Finish.FAULTED, reason, "engine", retract=True)
        loop.go(above, loop.plan.travel_m_s)
        loop.wait_until(loop.clock.now() + loop.plan.settle_s)
    loop.monitor.tare()
    loop.known_levels = {name: (0.0, loop.usual.error_n(name)) for name in near}


def _note_drift(loop: RunLoop, in_the_air: Levels) -> None:
    """A zero that moved since the tare was in every force of that press."""
    loop.zero_unseen = False
    if loop.known_levels is None:
        return
    drift = changed(loop.known_levels, in_the_air, NOTED_SHARE * loop.most_n)
    if drift is not None:
        loop.bus.note("warning", "engine", f"{drift} in the air since the last tare: the "
                      "forces of the press before are off by up to that")  # fmt: skip


def note_last_drift(loop: RunLoop) -> None:
    """Look whether the zero moved in the last press, too."""
    try:
        _note_drift(loop, _levels(loop))
    except DeviceFault as fault:  # what was asked for is complete
        note_unseen(loop, fault.device, fault.reason)


def note_unseen(loop: RunLoop, device: str, why: str) -> None:
    """The last complete press was never held to a zero after it."""
    text = f"{why}: whether its zero moved in the last press is not known"
    loop.bus.note("warning", device, text)


def _levels(loop: RunLoop) -> Levels:
    """Force of each sensor at rest: its mean over a tenth of a second, and how sure it is.

    Taken again while something shakes the probe.
    """
    levels = level_at_rest(loop)
    until_s = loop.clock.now() + MAX_UNSTEADY_S
    while (shaken := loop.usual.unsteady(levels)) and loop.clock.now() < until_s:
        levels = level_at_rest(loop)
    if shaken:
        loop.bus.note("warning", "engine", f"{shaken} at rest in the air, where its zero is "
                      "taken: forces may be off by several times that")  # fmt: skip
    loop.usual.add(levels)
    return levels


def next_level(loop: RunLoop) -> Levels:
    """Of `LEVEL_S` from now on, and as much longer, at most, as it takes until that is read."""
    from_s = loop.clock.now()
    loop.wait_until(from_s + LEVEL_S)
    until_s = loop.clock.now() + LEVEL_S
    while loop.status.seen_s < from_s + LEVEL_S and loop.clock.now() < until_s:
        loop.tick(math.inf)
    return loop.monitor.levels(from_s)


def level_at_rest(loop: RunLoop) -> Levels:
    """Of a probe that has settled, of two readings at least. Raises `DeviceFault`."""
    loop.wait_until(loop.clock.now() + loop.plan.settle_s)
    from_s = loop.clock.now()
    levels = next_level(loop)
    while unknown(levels) is not None and loop.clock.now() < from_s + MAX_LEVEL_S:
        loop.tick(math.inf)  # a slow sensor, or a busy machine: one reading is no level
        levels = loop.monitor.levels(from_s)
    if (silent := unknown(levels)) is not None:
        raise DeviceFault(silent, f"fewer than two readings within {MAX_LEVEL_S:g} s at rest")
    return levels
