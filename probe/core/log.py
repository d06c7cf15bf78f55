"""A run's notes and faults in Python's own logging, under the logger ``palpate``."""

import logging

from probe.core.events import Event, Note, PhaseEntered, RunEnded, RunStarted, StationStarted

LOGGER = logging.getLogger("palpate")
LOGGER.addHandler(logging.NullHandler())
LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "fault": logging.ERROR}


def log_event(event: Event) -> None:
    """An observer of a scan: notes at their own level, all else but samples for debugging."""
    match event:
        case Note():
            LOGGER.log(LEVELS.get(event.level, logging.WARNING), "%s", event.words)
        case RunStarted():
            LOGGER.debug("run started %s: %s", event.started_utc, ", ".join(event.channels))
        case StationStarted():
            LOGGER.debug(
                "station %d, attempt %d, at x = %.2f mm, y = %.2f mm",
                event.station + 1, event.attempt, 1e3 * event.x_m, 1e3 * event.y_m,
            )  # fmt: skip
        case PhaseEntered():
            LOGGER.debug("%s", event.phase.value)
        case RunEnded():
            LOGGER.debug("run %s: %s", event.finish.value, event.reason)
