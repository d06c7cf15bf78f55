"""A run's events as lines that a person reads."""

from collections.abc import Iterable, Iterator

from probe.core.events import (
    Event,
    Note,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.core.places import place_words, plans_rows


def lines(events: Iterable[Event]) -> Iterator[str]:
    """One line per event; the samples of a phase are counted in one line."""
    counted: dict[str, int] = {}
    in_grid = False
    for event in events:
        if isinstance(event, RunStarted):
            in_grid = plans_rows(event.config)
        if isinstance(event, Samples):
            counted[event.device] = counted.get(event.device, 0) + len(event.block.time_s)
            continue
        if counted:
            yield " " * 11 + ", ".join(f"{n} samples of {one}" for one, n in counted.items())
            counted = {}
        yield f"{event.time_s:9.3f}  {_line(event, in_grid=in_grid)}"


def _line(event: Event, *, in_grid: bool) -> str:
    match event:
        case RunStarted():
            return f"run started {event.started_utc}: {', '.join(event.channels)}"
        case StationStarted():
            attempt = f", attempt {event.attempt}" if event.attempt > 1 else ""
            place = place_words(event.x_m, event.y_m, in_grid=in_grid)
            return f"station {event.station + 1} at {place}{attempt}"
        case PhaseEntered():
            return f"  {event.phase.value}"
        case StationEnded():
            return f"station {event.station + 1} {'complete' if event.complete else 'broken off'}"
        case Note():
            return f"{event.level}: {event.words}"
        case RunEnded():
            return f"run {event.finish.value}: {event.reason}"
        case Samples():
            return f"{len(event.block.time_s)} samples of {event.device}"
