"""Press where most is learnt of what lies beneath a row, and stop when it is decided.

After three presses, spread evenly, every press is the one that tells most about kind and place, by
the posterior of all that was measured (`probe.detection.beneath.weighed`). A press tells about
whatever its readings differ in from one hypothesis to the other, more than within each: half the
logarithm of the ratio of variances is about the information [nat] of a Gaussian reading (Lindley
1956, An. Math. Stat. 27, 986).
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from drivers.core.arrays import Array
from probe.deciding.limits import Chance, Limits, Positive
from probe.deciding.presses_made import PressesMade
from probe.detection.beneath.hypotheses import Likelihood
from probe.detection.beneath.known import MIN_PLACES
from probe.detection.beneath.row_evidence import NONE, RowEvidence, row_evidence
from probe.detection.beneath.weighed import MOST, Weighed
from probe.detection.classify.kinds import ELSE
from probe.detection.finding import LUMP, VESSELS, ObjectFinding
from probe.detection.pulse.presses import presses_of
from probe.detection.repeats import pitch_m
from probe.planning.plan import Place, Plan
from probe.planning.planner import ALL, Done, Press

DRAWS = 200
"""Points of a posterior by which a press is chosen."""
LEAST = 1e-3
"""Information [nat] of a press that is still worth its contact. Over the paper's lump at 0.5 mN the
ninth press is the last; six more move its chance from 90 to 91 %."""
SAME_PLACE_M = 2e-3
"""Places as near as that are one to a choice."""


class Decide(PressesMade):
    """The most telling press next, until what lies beneath is known.

    Parameters
    ----------
    plan
        The stations to choose among, in one row, and the longest hold.
    false_alarm
        The chance that the scan stops for something where there is nothing.
    misses
        The chance that it stops for nothing where something lies, or for a lump where a vessel
        does, or the other way round. Whether a vessel is healthy is named as `detect` does.
    place_mm
        Half of the 95 % interval to which the place of what was found is to be known; by default
        the distance of two stations.
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
        place_mm: Positive | None = None,
        presses: Annotated[int, Field(ge=1)] | None = None,
        contact_s: Positive | None = None,
        dose_n_s: Positive | None = None,
    ) -> None:
        if len({place.y_m for place in plan.places}) > 1:
            raise ValueError('it chooses along one row; for a grid say "coarse-to-fine"')
        super().__init__(plan, false_alarm / 2, Limits(presses, contact_s, dose_n_s))
        self._false_alarm, self._misses = false_alarm, misses
        x_m = np.array([place.x_m for place in plan.places])
        self._place_m = 1e-3 * place_mm if place_mm else pitch_m(x_m)

    def ask(self) -> Press | Done:
        """The station that tells most; the first are in the middle of each third of the row."""
        rest = self._missing()
        if not rest:
            return Done(ALL)
        if (why := self._spent()) is not None:
            return Done(why)
        place = self._first(rest)
        if place is None:
            evidence = self._evidence()
            if evidence and (said := self._decided(evidence)):
                return Done(f"decided {self._count}: {said}")
            place, gain = _most_telling(evidence, rest) if evidence else (rest[0], np.inf)
            if gain < LEAST:
                return Done(f"no station that is left tells more, {self._count}")
        return Press(place, self._plan.indentation_m, self._holds_s)

    def _first(self, rest: Sequence[Place]) -> Place | None:
        """What is still to be pressed before anything is weighed."""
        x_m = np.array([place.x_m for place in self._plan.places])
        thirds_m = x_m.min() + np.ptp(x_m) * (np.array([1, 0, 2]) + 0.5) / MIN_PLACES
        wanted = [self._plan.places[int(np.argmin(np.abs(x_m - at_m)))] for at_m in thirds_m]
        return next((place for place in wanted if place in rest), None)

    def _evidence(self) -> RowEvidence | None:
        row = self._so_far()
        said = row_evidence(row, presses_of(row, self._false_alarm / 2))
        return None if isinstance(said, str) else said

    def _decided(self, evidence: RowEvidence) -> str | None:
        if not evidence.objects:
            nothing = evidence.hypotheses.of(0)
            return f"nothing, {100 * nothing:.0f} %" if 1 - nothing <= self._misses else None
        sure = [thing for thing in evidence.objects if self._named(thing)]
        return ", ".join(f"{t.kind}, {100 * t.confidence:.0f} %" for t in sure) or None

    def _named(self, thing: ObjectFinding) -> bool:
        """Whether an object is there, in its place and of its kind, each as surely as is asked."""
        low_m, high_m = thing.position_ci_m
        there = thing.chances[NONE] + thing.chances[ELSE] <= self._false_alarm
        vessel = sum(thing.chances[name] for name in VESSELS)
        other = thing.chances[LUMP] if thing.is_vessel else vessel
        placed = high_m - low_m <= 2 * self._place_m
        return thing.is_named and there and placed and other <= self._misses


def _most_telling(evidence: RowEvidence, rest: Sequence[Place]) -> tuple[Place, float]:
    """Of the stations that are left the one with the most information on kind and place, and how
    much that is [nat]."""
    likelihood, row = evidence.likelihood, evidence.hypotheses
    x = (np.array([place.x_m for place in rest]) - likelihood.middle_m) / likelihood.half_width_m
    readings, weight, group = _predicted(row, likelihood, x)
    gain = sum(_information(readings[..., k], weight, group, noise)
               for k, noise in enumerate(_noise(likelihood)))  # fmt: skip
    return rest[int(np.argmax(gain))], float(np.max(gain))


def _predicted(row: Weighed, likelihood: Likelihood, x: Array) -> tuple[Array, Array, Array]:
    """Share of the bare force that is added and pulse over force (m, n, 2) at places ``x`` (n,) for
    points of the posterior, their weights (m,), and of which bodies at which places each is
    (m, 1 + b)."""
    readings, weight = [np.zeros((1, len(x), 2))], [np.array([row.of(0)])]
    group, rng = [np.full((1, 1 + MOST), -1.0)], np.random.default_rng(0)
    for which, (bodies, posterior) in enumerate(row.posteriors.items()):
        drawn = rng.choice(len(posterior.points), DRAWS, p=posterior.weights)
        points = posterior.points[drawn]
        added, pulse = np.moveaxis(likelihood.added(bodies, points, x)[:, :, -1], -1, 0)
        total = np.maximum(1 + added, 1e-3)
        readings.append(np.stack([np.log(total), pulse / total], axis=-1))
        weight.append(np.full(DRAWS, row.chances[bodies] / DRAWS))
        of = np.full((DRAWS, 1 + MOST), float(which))
        places_m = likelihood.half_width_m * bodies.places(points).T
        of[:, 1 : 1 + len(bodies.kinds)] = np.round(places_m / SAME_PLACE_M)
        group.append(of)
    return np.concatenate(readings), np.concatenate(weight), np.concatenate(group)


def _noise(likelihood: Likelihood) -> tuple[float, float]:
    """Standard deviations of a press's force and pulse, over its force."""
    data, priors = likelihood.data, likelihood.priors
    force = float(np.median(data.force_n[:, -1]))
    steep = float(np.median(data.slope_n_per_m[:, -1])) / force
    heights_m = 1e-3 * np.hypot(priors.waves_mm, priors.repeatability_mm)
    noise = float(np.median(data.force_sd_n[:, -1])) / force
    return float(np.hypot(noise, steep * heights_m)), float(np.median(data.pulse_sd_n)) / force


def _information(value: Array, weight: Array, group: Array, noise: float) -> Array:
    """Of a reading (m, n) with its ``noise`` about the groups (m, g), at each of n places [nat]."""
    weight = weight / weight.sum()
    away = value - weight @ value
    _, of = np.unique(group, axis=0, return_inverse=True)
    share = np.bincount(of, weight)
    mean = np.stack([np.bincount(of, weight * column) for column in away.T], axis=1)
    between = (mean**2 / np.maximum(share, 1e-300)[:, None]).sum(axis=0)
    within = weight @ away**2 - between
    return np.asarray(0.5 * np.log1p(between / (np.maximum(within, 0) + noise**2)))
