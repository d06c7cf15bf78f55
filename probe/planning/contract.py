"""What every planner has to do, tried on readings that are there: for the tests of your own."""

from collections.abc import Callable
from dataclasses import replace

from probe.core.recording import Recording
from probe.planning.plan import Plan
from probe.planning.planner import Done, Judging, Planner, Press, Told, refusal

Made = list[tuple[Press, bool]]


def check_planner(make: Callable[[Plan], Planner], plan: Plan, recording: Recording) -> list[Press]:
    """The presses that a planner asks for until it is done, if it keeps the contract.

    Parameters
    ----------
    make
        What makes it of a plan, as its entry point does.
    plan
        What it chooses among.
    recording
        Every station of the plan: what it is told.

    Raises
    ------
    AssertionError
        It asks for what is none of the plan or not allowed, does not end, chooses otherwise after
        the same readings, or goes wrong when a resumed scan tells it some of them first.

    Examples
    --------
    >>> import palpate
    >>> from probe.planning.contract import check_planner
    >>> from probe.planning.planner import Raster
    >>> plan = palpate.plan_for(palpate.default_rig())
    >>> len(check_planner(Raster, plan, palpate.open_run("TIHA.run").recording()))
    15
    """
    first = _played(make(plan), plan, recording, [])
    assert first == _played(make(plan), plan, recording, []), (
        "after the same readings it chooses otherwise: draw random numbers from a seed of its own"
    )
    half = [press.place.index for press, _ in first[: len(first) // 2]]
    rest = _played(make(plan), plan, recording, half)
    assert not {press.place.index for press, _ in rest} & set(half)
    return [press for press, _ in first]


def _played(planner: Planner, plan: Plan, recording: Recording, told: list[int]) -> Made:
    """Each press, and whether its hold ended early; ``told`` are complete before it is asked."""
    readings = {s.index: replace(recording, stations=(s,)) for s in recording.stations}
    complete, made = set(told), Made()
    if isinstance(planner, Told):
        for index in told:
            planner.tell(readings[index])
    for _ in range(2 * len(plan.places) + 1):
        choice = planner.ask()
        if isinstance(choice, Done):
            assert choice.reason, "Done needs a reason: it is kept in the run"
            return made
        assert isinstance(choice, Press), f"it asks for {choice!r:.60}, and not for Press or Done"
        assert choice.place in plan.places, f"{choice.place!r} is none of the plan's stations"
        assert (why := refusal(choice, plan)) is None, why
        index = choice.place.index
        if index in complete:
            continue
        complete.add(index)
        reading, early = readings[index], False
        if isinstance(planner, Judging) and len(choice.holds_s) > 1:
            early = planner.enough(reading)
        made.append((choice, early))
        if isinstance(planner, Told):
            planner.tell(reading)
    raise AssertionError("it asks for nothing but stations that are complete")
