"""From a recording to its finding: presses, rows, objects, and over a grid a vessel's course."""

from collections.abc import Iterable
from dataclasses import replace
from os import PathLike

import numpy as np

from drivers.core.arrays import Array
from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.core.finding_words import NORMAL_95, percent, plain
from probe.core.recording import Recording
from probe.detection.beneath.grid_sizes import with_sizes
from probe.detection.beneath.row_evidence import RowEvidence, row_evidence
from probe.detection.finding import (
    NAMED,
    UNDECIDED,
    Finding,
    Kind,
    ObjectFinding,
    StationFinding,
    stated,
    without_stress,
)
from probe.detection.heart_rate import heart_rate
from probe.detection.hold_down import hold_down
from probe.detection.lone_vessel import beside, lone_vessel, pulsing_place
from probe.detection.map.area import MIN_PRESSES
from probe.detection.map.bumps import MIN_STATIONS
from probe.detection.map.objects import objects_in
from probe.detection.map.open_row import least_bump_pa, only_pulses, open_objects
from probe.detection.map.pressed import in_row, over_area
from probe.detection.map.row_doubts import DOUBT, beside_named, between_rows, doubtful
from probe.detection.map.row_shapes import with_edges
from probe.detection.map.rows_or_area import is_area, runs_along_rows
from probe.detection.map.straight_line import or_lines, unnamed_line
from probe.detection.map.vessel_tracking import across_rows
from probe.detection.priors import Priors, priors_of
from probe.detection.pulse.causes import MOVERS
from probe.detection.pulse.estimate import Pulse
from probe.detection.pulse.least_pulse import chance_each, least_pulse_pa
from probe.detection.pulse.possible_rates import FASTEST_HZ, SLOWEST_HZ
from probe.detection.pulse.presses import Press, chance_of_pulse, presses_of
from probe.detection.repeats import MIN_NAMED, distinct_m, pitch_m
from probe.detection.sizes import unknown
from probe.detection.unequal_depths import in_words
from probe.storage.run import recording_of

SHOWN_SIGMAS = 5.0
"""Standard deviations of its size above which a pulse shows whose beats come from a reference."""
NOISE_SIGMAS = 3.08
"""Standard deviations that noise alone gives the size of a wave at a known rate in one press of
twenty: the root of chi-squared's 95 % with four degrees of freedom, sine and cosine of the two
harmonics that hold most of an arterial wave."""
UNFINISHED = "the map is not finished: further presses may change this"
HEALTHY_PULSE_N = 0.0455
"""Pulse of the paper's healthy artery (TIHA), pressed 2.5 mm by a finger 10 mm long, between 80 and
120 mmHg (`palpate press TIHA --x 32 --depth 2.5 --pressure 80 --pressure 120`)."""


def detect(
    source: Recording | str | PathLike[str],
    *,
    false_alarm: float = DEFAULT_FALSE_ALARM,
    asked_pa: float | None = None,
    priors: Priors | str | PathLike[str] | None = None,
) -> Finding:
    """What lies beneath a scan, and where.

    Parameters
    ----------
    source
        A recording, a run, or a run file; real and simulated ones are read alike.
    false_alarm
        The chance that a scan over nothing finds something: half of it is spent on the
        pulse, half on the level map. Where more than twice the default is asked for (more
        than it in a single press), less sure causes count as pulses too.
    asked_pa
        The smallest pulse, trough to crest [Pa], that "nothing" is to rule out: where the
        scan would not have shown it, the finding is "cannot see". By default it is that of
        the paper's healthy artery on this probe's face.
    priors
        What is believed of tissue, pressures and rig beforehand, or a TOML file of it, as
        ``diastolic_mmhg = [76, 80]`` by a cuff: depth and size depend on it.

    Returns
    -------
    Finding
        What was found. Never raises for what was recorded: a press that cannot be judged is
        a station with a ``note``.

    Raises
    ------
    RunFileError
        The file cannot be read, or is no run.
    ConfigError
        The file of priors names the key that is wrong.

    Examples
    --------
    >>> import palpate
    >>> palpate.detect("TIHA.run", asked_pa=200.0).finding
    'artery'
    """
    if not 0 < false_alarm < 1:
        raise ValueError(f"false_alarm is {false_alarm:g}; it is a chance between 0 and 1")
    recording, believed = recording_of(source), priors_of(priors)
    if recording.unit != "Pa":
        return without_stress(recording, false_alarm)
    if asked_pa is None:
        asked_pa = HEALTHY_PULSE_N / recording.face_m2
    elif not 0 < asked_pa < np.inf:
        raise ValueError(f"asked_pa is {asked_pa:g}; it is a pulse in Pa, more than 0 and finite")
    rows = recording.rows()
    in_rows = _most_places(recording, rows) >= MIN_STATIONS
    mapped = in_rows or is_area(recording.stations, rows)
    presses = presses_of(recording, false_alarm / 2 if mapped else false_alarm)
    judged = [[i for i in row if presses[i].pulse is not None] for row in rows]
    lines = [[presses[i] for i in row] for row in judged if row]
    unfinished = recording.finish != "completed"
    least_pa = float("inf")
    moving = chance_of_pulse(presses)
    evidence: RowEvidence | str | None = None
    if len(lines) == 1 and not unfinished:
        evidence = row_evidence(recording, lines[0], believed)
    if isinstance(evidence, RowEvidence):
        objects, least_pa = evidence.objects, float("nan")
    elif is_area(recording.stations, judged) or (
        moving is not None and runs_along_rows(presses, _pitch_m(recording))
    ):
        least_pa, lines = float("nan"), []
        area = over_area(presses)
        objects = objects_in(area, moving, false_alarm) or unnamed_line(area, false_alarm)
        if unfinished:
            objects = [thing.undecided(UNFINISHED) for thing in objects]
    elif _most_places(recording, judged) >= MIN_STATIONS:
        objects, least_pa = _in_rows(recording, presses, judged, false_alarm, unfinished)
    elif vessel := lone_vessel(presses, rows, recording.face_m2):
        objects = [vessel]
    else:
        objects = pulsing_place(presses, unfinished, recording.face_m2)
    if isinstance(evidence, str):
        objects = [replace(thing, sizes=unknown(evidence)) for thing in objects]
    elif evidence is None:
        objects = with_sizes(recording, lines, objects, believed)
    objects = [*objects, *_disturbed(presses)]
    objects = [replace(thing, confidence=stated(thing.confidence)) for thing in objects]
    objects.sort(key=lambda thing: (np.isnan(thing.position_m), thing.position_m))
    beats = heart_rate(presses)
    shown_pa = _shown_pa(presses, false_alarm / 2 if mapped else false_alarm)
    stations = tuple(
        _station(press, least, beats is not None)
        for press, least in zip(presses, shown_pa, strict=True)
    )
    known_pa = shown_pa[~np.isnan(shown_pa)]
    needed_pa = float(np.median(known_pa)) if len(known_pa) else float("nan")
    kind = _whole(objects, presses, unfinished)
    if kind == "nothing" and needed_pa > asked_pa:
        kind = "cannot see"
    elif (
        kind == "nothing"
        and np.isinf(least_pa)
        and any(np.isfinite(s.x_m) for s in recording.stations)
    ):
        kind = UNDECIDED  # of a recording without places only a pulse is asked
    if presses:
        reason = _reason(kind, objects, presses, (needed_pa, asked_pa), least_pa, unfinished)
    else:
        reason = _why_no_station(recording)
    reason = "; ".join(filter(None, (reason, in_words(presses))))
    return Finding(
        kind, tuple(objects), stations, reason, false_alarm, needed_pa, asked_pa,
        beats, believed, hold_down(recording, false_alarm),
    )  # fmt: skip


def _in_rows(
    recording: Recording, presses: tuple[Press, ...], rows: list[list[int]], false_alarm: float,
    unfinished: bool,
) -> tuple[list[ObjectFinding], float]:  # fmt: skip
    """The objects of all rows, and the least bump that every row would have shown.

    Of an unfinished scan the row of the last station is open.
    """
    last = max(range(len(presses)), key=lambda i: presses[i].station.index)
    least_pa: list[float] = []
    by_row, lines = [], [in_row([presses[i] for i in row]) for row in rows if row]
    for row, line in zip(filter(None, rows), lines, strict=True):
        in_line = tuple(presses[i] for i in row)
        is_open = unfinished and last in row
        if len(line.x_m) < MIN_STATIONS:
            objects = pulsing_place(in_line, is_open, recording.face_m2)
            least_pa.append(float("inf"))
        elif is_open:
            end_x_m = presses[last].station.x_m
            objects = open_objects(line, chance_of_pulse(in_line), false_alarm / len(rows), end_x_m)
            least_pa.append(least_bump_pa(line, false_alarm / len(rows), with_edges))
        else:
            objects = only_pulses(
                objects_in(line, chance_of_pulse(in_line), false_alarm / len(rows)), line
            )
            objects = beside_named(line, objects, DOUBT / len(rows)) if objects else []
            least_pa.append(least_bump_pa(line, false_alarm / len(rows)))
        by_row.append((recording.stations[row[0]].y_m, objects))
    named = across_rows(by_row, _pitch_m(recording))
    shown_pa = max(filter(np.isfinite, least_pa), default=float("inf"))
    y_m, area = [y_m for y_m, _ in by_row], over_area(presses)
    if (
        named
        and not unfinished
        and chance_of_pulse(presses) is None
        and len(area.level_pa) >= MIN_PRESSES
    ):
        named = or_lines(named, area.levels(), y_m)
    if named or unfinished:
        return named, shown_pa
    unclear = doubtful(lines, least_pa, y_m, _pitch_m(recording))
    return unclear or between_rows(lines, y_m), shown_pa


def _disturbed(presses: tuple[Press, ...]) -> list[ObjectFinding]:
    """Where something moves that may be a pulse or not: undecided, with what would decide it.

    Nothing is said of it where another press has a pulse: then the disturbed one is only noted.
    """
    moved = [p for p in presses if p.cause is not None and not p.pulsing]
    if any(p.pulsing for p in presses):
        return []
    if not moved:
        return _beyond(presses)
    press = min(moved, key=lambda p: p.pulse.p_value if p.pulse else 1.0)
    assert press.cause is not None
    rival = press.cause.rival
    x_m = press.station.x_m
    return [ObjectFinding(
        UNDECIDED, x_m, beside(x_m, presses), float("nan"), press.size_pa, press.cause.pulse,
        f"something moves at station {press.station.index + 1}: a pulse with "
        f"{percent(press.cause.pulse)}, {rival} with {percent(press.cause.share[rival])}; "
        f"{MOVERS[rival].advice}, or hold longer",
    )]  # fmt: skip


def _beyond(presses: tuple[Press, ...]) -> list[ObjectFinding]:
    """What beats at a rate that no pulse is looked for at: undecided, where it is largest."""
    beating = [p for p in presses if p.beyond_hz is not None]
    if not beating:
        return []
    press = max(beating, key=lambda p: p.size_pa)
    x_m, slow, fast = press.station.x_m, 60 * SLOWEST_HZ, 60 * FASTEST_HZ
    return [ObjectFinding(
        UNDECIDED, x_m, beside(x_m, presses), float("nan"), press.size_pa, 0.0,
        f"something beats about {60 * (press.beyond_hz or 0.0):.0f} times a minute at station "
        f"{press.station.index + 1}; a pulse is looked for at {slow:.0f} to {fast:.0f}: compare "
        "with a reference (PPG or ECG), or hold longer",
    )]  # fmt: skip


def _x_m(recording: Recording, stations: Iterable[int]) -> Array:
    return np.array([recording.stations[i].x_m for i in stations])


def _pitch_m(recording: Recording) -> float:
    return pitch_m(_x_m(recording, range(len(recording.stations))))


def _most_places(recording: Recording, rows: list[list[int]]) -> int:
    """Places in the longest of ``rows``: repeats at one place make no row."""
    return max((len(distinct_m(_x_m(recording, row))) for row in rows), default=0)


def _shown_pa(presses: tuple[Press, ...], false_alarm: float) -> Array:
    """The smallest pulse that each press would have shown (n,); NaN where it cannot be judged.

    ``false_alarm`` is the chance of a false pulse in all of them.
    """
    each = chance_each(false_alarm, sum(p.pulse is not None for p in presses))

    def shown(pulse: Pulse | None) -> float:
        if pulse is None:
            return float("nan")
        if pulse.search is None:
            return SHOWN_SIGMAS * pulse.size_sd_pa
        return least_pulse_pa(pulse.search, each)

    return np.array([shown(p.pulse) for p in presses])


def _whole(objects: list[ObjectFinding], presses: tuple[Press, ...], unfinished: bool) -> Kind:
    if not any(p.pulse is not None for p in presses):
        return UNDECIDED
    kinds = {thing.kind for thing in objects}
    order = (*NAMED, UNDECIDED)
    return next((kind for kind in order if kind in kinds), UNDECIDED if unfinished else "nothing")


def _reason(
    kind: Kind, objects: list[ObjectFinding], presses: tuple[Press, ...],
    bounds_pa: tuple[float, float], least_pa: float, unfinished: bool,
) -> str:  # fmt: skip
    """Why, in a sentence; where nothing was found, how much could still be hidden.

    ``least_pa``: the bump that would have shown; infinite where none could, NaN if unknown.
    """
    judged = [p for p in presses if p.pulse is not None]
    if not judged:
        if presses and not any(p.touched for p in presses):
            return (
                f"no contact: none of {len(presses)} presses met anything; check the height of the "
                "surface, the tare and that the sensor answers"
            )
        first = next((p.note for p in presses if p.note), "none has enough samples")
        return f"no press can be judged: {first}"
    if objects:
        return _reasons(objects)
    needed_pa, asked_pa = bounds_pa
    if unfinished:
        x_mm = 1e3 * distinct_m(np.array([p.station.x_m for p in judged]))
        where = f"between {x_mm[0]:.0f} and {x_mm[-1]:.0f} mm yet" if len(x_mm) else "yet"
        if np.isinf(least_pa):
            return (
                f"the row is not finished; no pulse {where}, and a lump needs a row of {MIN_NAMED} "
                "stations"
            )
        return f"the row is not finished; nothing {where}, the tissue's edge aside"
    if kind == "cannot see":
        return (
            f"to see a pulse of {plain(asked_pa, 2)} Pa hold for more beats, repeat, or take a "
            "quieter sensor or a larger face"
        )
    text = f"no pulse (one of {plain(needed_pa, 2)} Pa would have shown)"
    if np.isinf(least_pa):
        return f"{text}; a lump needs a row of {MIN_NAMED} stations"
    text = f"{text}, and no place stiffer or softer than its surroundings"
    return text if np.isnan(least_pa) else f"{text} ({plain(least_pa, 2)} Pa would have shown)"


def _why_no_station(recording: Recording) -> str:
    if recording.finish == "completed":  # nothing broke it off
        return "the run has no complete station"
    why = recording.ended or "it was broken off in the first press, or is still in it"
    how = (
        {"faulted": "a fault ended it: ", "aborted": "it was stopped: "}[recording.finish]
        if (recording.ended and recording.finish in ("faulted", "aborted"))
        else ""
    )
    return f"the run has no complete station; {how}{why}"


def _reasons(objects: list[ObjectFinding]) -> str:
    """Each reason once; one that only one of several objects has, with that one's place."""
    all_reasons = [thing.reason for thing in objects]
    placed = [
        thing.reason
        if len(objects) == 1 or all_reasons.count(thing.reason) > 1 or np.isnan(thing.position_m)
        else f"at x = {1e3 * thing.position_m:.2f} mm: {thing.reason}"
        for thing in objects
        if thing.reason
    ]
    return "; ".join(dict.fromkeys(placed))


def _station(press: Press, shown_pa: float, beats: bool) -> StationFinding:
    """``shown_pa``: the smallest pulse that it would have shown. ``beats``: a heart's pulse was
    found in the scan, at whose rate this press was measured."""
    s, p = press.station, press.pulse
    note = press.note
    if press.cause is not None and not press.pulsing:
        moved = f"what moves is more likely {press.cause.rival} than a pulse"
        if press.cause.pulse < press.cause.share[press.cause.rival]:
            note = f"{note}; {moved}" if note else moved
    station = StationFinding(s.index + 1, s.x_m, s.y_m, press.clipped, note)
    if p is None:
        return station
    return replace(
        station,
        baseline_pa=p.baseline_pa,
        baseline_sd_pa=p.baseline_sd_pa,
        pulse_pa=p.size_pa,
        pulse_sd_pa=p.size_sd_pa,
        pulse_below_pa=_below_pa(press, p, shown_pa, beats),
        rate_hz=p.rate_hz,
        p_value=p.p_value,
    )


def _below_pa(press: Press, pulse: Pulse, shown_pa: float, beats: bool) -> float:
    """What the pulse is below where it may be noise's own; NaN where something moves.

    Where no heart's rate is known, a pulse that would not have shown may be larger than what was
    fitted at the clearest one.
    """
    moves = press.pulsing or press.cause is not None or press.beyond_hz is not None
    if moves or (beats and pulse.size_pa >= NOISE_SIGMAS * pulse.size_sd_pa):
        return float("nan")
    fitted_pa = pulse.size_pa + NORMAL_95 * pulse.size_sd_pa
    return fitted_pa if beats else max(fitted_pa, shown_pa)
