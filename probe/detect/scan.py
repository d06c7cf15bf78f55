"""From a recording to its finding: presses, rows, objects, and over a grid a vessel's course."""

from dataclasses import replace

import numpy as np

from probe.detect.bumps import FEWEST
from probe.detect.course import across_rows
from probe.detect.finding import Finding, Kind, ObjectFinding, StationFinding
from probe.detect.objects import line_of, objects_in
from probe.detect.presses import Press, presses_of
from probe.recording import Recording

ORDER: tuple[Kind, ...] = ("stenotic artery", "artery", "tumour", "undecided")
"""Which object's kind is the whole finding's: the one that a person would act on."""

VISIBLE = 5.0
"""Standard deviations of its size above which a pulse shows."""


def detect(recording: Recording, *, false_alarm: float = 0.01) -> Finding:
    """What lies beneath a scan, and where.

    ``false_alarm`` is the chance that a scan over nothing finds something: half of it is spent on
    the pulse, half on the level map. Works on real and simulated recordings alike. Never raises
    for what was recorded: a press that cannot be judged is a station with a ``note``.
    """
    if not 0 < false_alarm < 1:
        raise ValueError(f"false_alarm is {false_alarm:g}; it is a chance between 0 and 1")
    rows = recording.rows()
    row_of_stations = max((len(r) for r in rows), default=0) >= FEWEST
    budget = false_alarm / 2 if row_of_stations else false_alarm
    presses = presses_of(recording, budget)
    if row_of_stations:
        share = false_alarm / len(rows)
        found = [
            (
                recording.stations[row[0]].y_m,
                objects_in(
                    line_of(tuple(presses[i] for i in row)),
                    any(presses[i].pulsing for i in row),
                    share,
                ),
            )
            for row in rows
        ]
        objects = across_rows(found, _pitch_m(recording))
    else:
        objects = _from_few(presses)
    stations = tuple(_station(p) for p in presses)
    return Finding(
        _whole(objects, presses), tuple(objects), stations,
        _reason(objects, presses, row_of_stations), false_alarm,
    )  # fmt: skip


def _from_few(presses: tuple[Press, ...]) -> list[ObjectFinding]:
    """The one object that a pulse alone can show, where no row does."""
    if not any(p.pulsing for p in presses):
        return []
    judged = [p for p in presses if p.pulse is not None]
    clearest = min(judged, key=lambda p: p.pulse.p_value if p.pulse else 1.0)
    gaps = np.diff(sorted({p.station.x_m for p in judged}))
    reach = float(np.median(gaps)) if len(gaps) else float("nan")
    x_m = clearest.station.x_m
    return [
        ObjectFinding(
            "artery", x_m, (x_m - reach, x_m + reach), float("nan"), clearest.size_pa,
            1 - min(1.0, clearest.pulse.p_value * len(judged)) if clearest.pulse else 0.0,
            f"it pulses; whether it is stenosed needs a row of {FEWEST} stations over it",
        )
    ]  # fmt: skip


def _pitch_m(recording: Recording) -> float:
    x_m = np.unique([round(s.x_m, 6) for s in recording.stations if np.isfinite(s.x_m)])
    return float(np.median(np.diff(x_m))) if len(x_m) > 1 else 0.0


def _whole(objects: list[ObjectFinding], presses: tuple[Press, ...]) -> Kind:
    if not any(p.pulse is not None for p in presses):
        return "undecided"
    kinds = {one.kind for one in objects}
    return next((kind for kind in ORDER if kind in kinds), "nothing")


def _reason(objects: list[ObjectFinding], presses: tuple[Press, ...], row_of_stations: bool) -> str:
    """Why, in a sentence; for a finding of nothing, how much could still be hidden."""
    judged = [p for p in presses if p.pulse is not None]
    if not judged:
        first = next((p.note for p in presses if p.note), "the recording has no complete station")
        return f"no press can be judged: {first}"
    told = "; ".join(dict.fromkeys(one.reason for one in objects if one.reason))
    if objects:
        return told
    smallest = float(np.median([p.pulse.size_sd_pa for p in judged if p.pulse]))
    text = f"no pulse (one of {VISIBLE * smallest:.2g} Pa would have shown)"
    if row_of_stations:
        return f"{text}, and no place stiffer or softer than its surroundings"
    return f"{text}; a lump would need a row of {FEWEST} stations or more to show"


def _station(press: Press) -> StationFinding:
    s, p = press.station, press.pulse
    found = StationFinding(s.index, s.x_m, s.y_m, press.clipped, press.note)
    if p is None:
        return found
    return replace(
        found,
        baseline_pa=p.baseline_pa,
        baseline_sd_pa=p.baseline_sd_pa,
        pulse_pa=p.size_pa,
        pulse_sd_pa=p.size_sd_pa,
        rate_hz=p.rate_hz,
        p_value=p.p_value,
    )
