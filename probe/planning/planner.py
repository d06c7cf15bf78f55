"""What chooses the next press: a planner is asked, and told what was read.

The words *ask* and *tell* are those of bluesky-adaptive. A planner chooses among the stations of
the plan, which were checked against every limit before anything moved; the plan's depth, hold
and force are the most that it may ask for. So the rig file says what may happen, a planner only
what does.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from probe.core.recording import Recording
from probe.planning.plan import Place, Plan

ALL = "every station is complete"


@dataclass(frozen=True)
class Press:
    """One press: where, how deep, and when its hold may end.

    With ``force_n`` it ends where the force reaches it, ``depth_m`` deep at most.
    ``holds_s`` are times into the hold, ascending. It ends at the first of them at which the
    planner has `Judging.enough`, and at the last in any case.
    """

    place: Place
    depth_m: float
    holds_s: tuple[float, ...]
    force_n: float | None = None


@dataclass(frozen=True)
class Done:
    """Nothing more is to be pressed, and why: the run ends with this reason."""

    reason: str


@runtime_checkable
class Planner(Protocol):
    """What a scan asks. It chooses the same after the same readings."""

    def ask(self) -> Press | Done:
        """The next press. A station that is complete is passed over, and the next is asked for."""
        ...


@runtime_checkable
class Told(Planner, Protocol):
    """A planner that hears what was read."""

    def tell(self, reading: Recording) -> None:
        """A press is complete: a recording of one station. A resumed scan tells all again."""
        ...


@runtime_checkable
class Judging(Told, Protocol):
    """A planner that ends holds early."""

    def enough(self, reading: Recording) -> bool:
        """Whether the hold that goes on may end now; ``reading`` as far as it is known."""
        ...


class Raster:
    """Every station of the plan, one after the other."""

    def __init__(self, plan: Plan) -> None:
        self._left = [whole_press(plan, place) for place in reversed(plan.places)]

    def ask(self) -> Press | Done:
        """The next station in the order of the plan."""
        return self._left.pop() if self._left else Done(ALL)


def whole_press(plan: Plan, place: Place) -> Press:
    """The press that the plan has at ``place``: as deep, hard and long as the rig file says."""
    return Press(place, plan.indentation_m, (plan.hold_s,), plan.force_n)


def refusal(press: Press, plan: Plan) -> str | None:
    """What is wrong with depth, force or hold of a press, and what is allowed; None if nothing."""
    station = f"station {press.place.index + 1}"
    if not 0 < press.depth_m <= plan.indentation_m:
        return (
            f"{station}: depth_m = {press.depth_m!r} is not above 0 and at most the "
            f"{plan.indentation_m:g} m of scan.indentation_mm"
        )
    if press.force_n is not None and not 0 < press.force_n <= (plan.force_n or 0.0):
        allowed = "is not allowed without scan.force_n"
        if plan.force_n is not None:
            allowed = f"is not above 0 and at most the {plan.force_n:g} N of scan.force_n"
        return f"{station}: force_n = {press.force_n!r} {allowed}"
    ends_s = press.holds_s
    if not (
        ends_s
        and list(ends_s) == sorted(ends_s)
        and all(0 <= end_s <= plan.hold_s for end_s in ends_s)
    ):
        return (
            f"{station}: holds_s = {ends_s!r} are not ascending times from 0 to the "
            f"{plan.hold_s:g} s of scan.hold_s"
        )
    return None
