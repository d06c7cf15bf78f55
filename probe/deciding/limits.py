"""Where a planner stops in any case: presses, seconds of contact, and dose."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from probe.core.recording import Recording
from probe.planning.plan import Plan

Positive = Annotated[float, Field(gt=0)]
Chance = Annotated[float, Field(gt=0, lt=0.5)]


@dataclass(frozen=True)
class Limits:
    """``presses``, ``contact_s``, and the force times its time ``dose_n_s`` [N s]; None: no
    limit but the plan's."""

    presses: int | None
    contact_s: float | None
    dose_n_s: float | None

    def reached(self, plan: Plan, readings: Sequence[Recording]) -> str | None:
        """Which of them the next press would exceed; ``readings`` are of one station each."""
        made = [_made(reading) for reading in readings]
        longest_s = plan.ramp_s + plan.hold_s
        contact_s = sum(seconds for seconds, _ in made)
        dose_n_s = sum(dose for _, dose in made)
        force_n = max((dose / seconds for seconds, dose in made), default=0.0)
        if self.presses is not None and len(made) >= self.presses:
            return f"{len(made)} presses are made, as many as planner.presses allows"
        if self.contact_s is not None and contact_s + longest_s > self.contact_s:
            return f"{contact_s:.1f} s of contact, and planner.contact_s allows no further press"
        if self.dose_n_s is not None and dose_n_s + force_n * longest_s > self.dose_n_s:
            return f"a dose of {dose_n_s:.1f} N s, and planner.dose_n_s allows no further press"
        return None


def _made(reading: Recording) -> tuple[float, float]:
    """Seconds of contact of a press, and its force times its time [N s]."""
    (station,) = reading.stations
    pressed = (station.time_s >= station.indent_s) & (station.time_s < station.retract_s)
    seconds = station.retract_s - station.indent_s
    return seconds, float(np.mean(station.signal_pa[pressed])) * reading.face_m2 * seconds
