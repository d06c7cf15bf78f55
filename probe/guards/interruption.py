"""Why a scan cannot simply go on."""

from dataclasses import dataclass

from probe.core.events import Finish


@dataclass(frozen=True)
class Trip:
    """Why a guard stopped the stage. ``can_retract``: the stage itself is still trusted."""

    time_s: float
    device: str
    reason: str
    can_retract: bool


class Interrupted(Exception):
    """The scan cannot simply go on. ``finish`` is None where the press is to be made again."""

    def __init__(self, finish: Finish | None, reason: str, device: str, *, retract: bool) -> None:
        super().__init__(reason)
        self.finish = finish
        self.reason = reason
        self.device = device
        self.retract = retract


def interruption_of(trip: Trip) -> Interrupted:
    """A guard has stopped the stage."""
    reason = f"{trip.device}: {trip.reason}"
    return Interrupted(Finish.FAULTED, reason, trip.device, retract=trip.can_retract)
