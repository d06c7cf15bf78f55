"""Which holds have a pulse: one that passes by itself or with its neighbours, and is no rival."""

from dataclasses import dataclass

import numpy as np

from probe.core.recording import Recording
from probe.detection.pulse.beat_train import BeatTrain, beat_train
from probe.detection.pulse.causes import (
    Cause,
    cause_of,
    coarse_of,
    evidence_of,
    least_posterior,
)
from probe.detection.pulse.estimate import SHORTEST_TRAIN_S, Clearest
from probe.detection.pulse.fit import design_of, fit
from probe.detection.pulse.hold_samples import Hold
from probe.detection.pulse.pooled_evidence import shared_chance, usual_excess
from probe.detection.repeats import pitch_m

REACH = 2
"""Stations to either side that are judged together with one: a vessel pulses that far."""
MAX_PRESSES_ASKED = 3
"""Clearest presses that are asked what moves in them: more would not change the answer."""


@dataclass(frozen=True)
class Beating:
    """``stations`` that have a pulse, the clearest first; what moves in those that were asked, and
    the likeliest ``trains`` of beats of those of them that are likelier uneven than steady."""

    stations: list[int]
    causes: dict[int, Cause]
    trains: dict[int, BeatTrain]


def which_pulse(
    measured: dict[int, tuple[Hold, Clearest]], recording: Recording, false_alarm: float
) -> Beating:
    """Which stations have a pulse.

    ``measured`` are the holds of ``recording`` and their clearest pulses, by station;
    ``false_alarm`` is the chance for the whole recording.
    """
    clear = _clear({i: pulse for i, (_, pulse) in measured.items()}, recording, false_alarm)
    return _causes({i: measured[i] for i in clear}, least_posterior(false_alarm))


def _causes(clear: dict[int, tuple[Hold, Clearest]], least: float) -> Beating:
    """What moves in the clearest presses, and which of ``clear`` then hold a pulse, with a
    posterior probability of ``least``.

    One that moves for another reason by itself is left out; the rest are asked together, since
    they share one heart.
    """
    asked = [i for i, (_, pulse) in clear.items() if pulse.search is not None][:MAX_PRESSES_ASKED]
    evidence, trains = {}, {}
    for i in asked:
        hold = clear[i][0]
        if hold.span_s < SHORTEST_TRAIN_S:
            continue
        coarse = coarse_of(hold, fit(hold, design_of(hold), np.empty((len(hold.time_s), 0))))
        train = beat_train(coarse)
        evidence[i] = evidence_of(coarse, train)
        if evidence[i]["uneven beats"] > evidence[i]["pulse"] - np.log(2):
            trains[i] = train
    if not evidence:  # a reference has answered, or the holds are too short to ask
        return Beating(list(clear), {}, {})
    causes = {i: cause_of([one]) for i, one in evidence.items()}
    disturbed = [i for i, cause in causes.items() if cause.is_no_pulse]
    steady = [i for i in evidence if i not in disturbed]
    if not steady:
        return Beating([i for i in asked if i not in evidence], causes, trains)
    together = cause_of([evidence[i] for i in steady])
    causes |= dict.fromkeys(steady, together)
    if together.pulse < least:
        return Beating([], causes, trains)
    return Beating([i for i in clear if i not in disturbed], causes, trains)


def _clear(pulses: dict[int, Clearest], recording: Recording, false_alarm: float) -> list[int]:
    """Stations with a pulse, the clearest first: by themselves, or else the clearest group.

    Each of the two ways gets half of ``false_alarm``, where there are two.
    """
    searches = {i: pulse.search for i, pulse in pulses.items() if pulse.search is not None}
    groups = _groups(recording, list(searches))
    budget = false_alarm / 2 if groups else false_alarm
    alone = [i for i in pulses if pulses[i].p_value * len(pulses) <= budget]
    if alone or not groups:
        return sorted(alone, key=lambda i: pulses[i].p_value)
    excess = usual_excess(list(searches.values()))
    chances = [shared_chance([searches[i] for i in group], excess) for group in groups]
    best = int(np.argmin(chances))
    if chances[best] * len(groups) > budget:
        return []
    return sorted(groups[best], key=lambda i: pulses[i].p_value)


def _groups(recording: Recording, indices: list[int]) -> list[list[int]]:
    """Around each station of a row, those within `REACH` pitches; each group once."""
    groups: dict[tuple[int, ...], None] = {}
    for row in recording.rows():
        mine = [i for i in row if i in indices]
        x_m = np.array([recording.stations[i].x_m for i in mine])
        pitch = pitch_m(x_m)
        if np.isnan(pitch):
            continue
        reach = (REACH + 0.5) * pitch
        for x in x_m[np.isfinite(x_m)]:
            near = tuple(mine[k] for k in np.flatnonzero(np.abs(x_m - x) <= reach))
            groups[near] = None
    return [list(group) for group in groups if len(group) > 1]
