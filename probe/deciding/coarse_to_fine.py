"""Coarse to fine: press far apart first, then beside what shows, and stop when it is decided.

A level of `Lattice` is pressed, then the stations beside what detection finds in it; if that does
not decide, the level with half the gaps is. A hold ends when its pulse is known, or when a pulse
that matters would have shown. That nothing lies beneath is only said of all stations.

To ask a hold twice raises false alarms: of 300 holds of noise 9.0 % pulse after 5 s where 10 % is
asked for, and 14.0 % (10.3 to 18.4) after 2.5 or 5 s. So a hold ends early at a chance that all of
its checks share, and what is found at a chance that all looks at the scan share.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from probe.deciding.lattice import Lattice
from probe.deciding.limits import Chance, Limits, Positive
from probe.deciding.presses_made import PressesMade
from probe.detection.finding import HEALTHY, ObjectFinding
from probe.detection.scan import detect
from probe.planning.plan import Place, Plan
from probe.planning.planner import ALL, Done, Press, whole_press

NONE = ("nothing", "one press that differs", "an uneven row")
"""What explains a place without anything beneath it."""


class CoarseToFine(PressesMade):
    """Far apart first, then finer where something shows.

    Parameters
    ----------
    plan
        The stations to choose among, and the longest hold.
    false_alarm
        The chance that the scan stops for something where there is nothing.
    misses
        The chance that it stops for a healthy artery where there is disease.
    presses, contact_s, dose_n_s
        Where it stops in any case: presses, seconds of contact, and the force times its time
        [N s]. By default only the plan limits them.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        false_alarm: Chance = 0.01,
        misses: Chance = 0.05,
        presses: Annotated[int, Field(ge=1)] | None = None,
        contact_s: Positive | None = None,
        dose_n_s: Positive | None = None,
    ) -> None:
        super().__init__(plan, false_alarm, Limits(presses, contact_s, dose_n_s))
        self._lattice = Lattice(plan.places)
        levels = list(self._lattice.levels())
        self._levels = iter(levels)
        self._false_alarm = false_alarm / max(2 * (len(levels) - 1), 1)  # two looks at each level
        self._misses = misses
        self._queue: list[Place] = []
        self._besides: bool | None = None  # of this level have been pressed; None: none is begun

    def ask(self) -> Press | Done:
        """The next of what was chosen last; after these, what they show chooses anew."""
        while not (queue := list(filter(self._is_missing, self._queue))):
            if (done := self._choose()) is not None:
                return done
        if (why := self._spent()) is not None:
            return Done(why)
        self._queue = queue[1:]
        return replace(whole_press(self._plan, queue[0]), holds_s=self._holds_s)

    def _is_missing(self, place: Place) -> bool:
        return place.index not in self._readings

    def _choose(self) -> Done | None:
        """Queue the stations beside what was found, or the next level; or it is done."""
        if not self._missing():
            return Done(ALL)
        if self._besides is not None and self._readings:
            finding = detect(self._so_far(), false_alarm=self._false_alarm)
            if not self._besides:
                self._besides = True
                points_m = [point for thing in finding.objects for point in self._points_m(thing)]
                self._queue = list(filter(self._is_missing, self._lattice.beside(points_m)))
                if self._queue:
                    return None
            if finding.objects and all(self._decided(thing) for thing in finding.objects):
                best = max(thing.confidence for thing in finding.objects)
                return Done(f"decided {self._count}: {finding.finding}, {100 * best:.0f} %")
        self._queue, self._besides = next(self._levels), False
        return None

    def _decided(self, thing: ObjectFinding) -> bool:
        if not thing.is_named:
            return False
        none = sum(thing.chances.get(name, 0.0) for name in NONE)
        return none <= self._false_alarm and (
            thing.kind != HEALTHY or thing.diseased <= self._misses
        )

    def _points_m(self, thing: ObjectFinding) -> list[tuple[float, float]]:
        """Where it lies: along its course, or in each row."""
        rows_m = dict.fromkeys(reading.stations[0].y_m for reading in self._readings.values())
        points_m = thing.course or [(thing.position_m, y_m) for y_m in rows_m]
        return [point for point in points_m if np.isfinite(point).all()]
