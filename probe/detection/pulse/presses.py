"""Every press of a recording: its level, its pulse at a rate that all share, and their doubts."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.core.arrays import Bools
from probe.core.recording import Recording, Station
from probe.detection.finding import stated
from probe.detection.pulse.at_heart_rate import heart_of, pulse_at
from probe.detection.pulse.calm_half import clearest_part
from probe.detection.pulse.causes import Cause
from probe.detection.pulse.estimate import Clearest, Pulse
from probe.detection.pulse.fit import design_of, fit
from probe.detection.pulse.has_pulse import Beating, which_pulse
from probe.detection.pulse.hold_samples import Hold, NoContact, NoHold, dead_channels, hold_of
from probe.detection.pulse.least_noise import least_noise
from probe.detection.pulse.reference import contradicted, find_pulse_by
from probe.detection.pulse.rounding import unrounded, within_steps
from probe.detection.pulse.search import Prior, beyond
from probe.detection.pulse.shared_noise import noise_priors
from probe.detection.pulse.size import averaged, together
from probe.detection.pulse.uneven_beats import beats_of

REPEATABILITY_M = 10e-6
"""What a stage's depth differs by from station to station."""
STIFFENING = 1.15
"""Exponent of a cylinder's force against depth, between a flat face's 1 and a sphere's 1.5."""
UNKNOWN_DEPTH = 0.005
"""Station scatter over the level where no depth was recorded."""
MOST_NAMED = 3
"""Channels of an array that a note names."""
CONTRADICTED = "its reference beats otherwise than its force: judged without it"
LEAST_BEAT = 0.5
"""Beats that a hold must have seen for its pulse's size: in less it may have met neither crest nor
trough. In rows of holds of 2 s with one of 0.4 s, 0.48 beats, 7 of 10 intervals of its pulse did
not hold, by up to 10 standard deviations."""
LEAST_LOST = 0.005
"""Share of a hold's samples that a note says are missing: it gives whole per cent."""


@dataclass(frozen=True)
class Press:
    """A station with its pulse; None where there was nothing to judge by, and ``note`` says why.

    ``clipped`` is the share of the hold's samples that saturation took. ``level_sd_pa`` includes
    what a stage's repeatability makes of equal tissue. ``pulsing``: it, or it with its neighbours,
    passes the test for a pulse, and a pulse it is rather than breathing, motion or a machine;
    ``cause`` says so of those that were asked. ``touched``: the probe met something.
    ``beyond_hz``: in a scan without a pulse, what beats slower or faster than hearts do.
    """

    station: Station
    pulse: Pulse | None
    level_sd_pa: float
    clipped: float
    note: str = ""
    pulsing: bool = False
    cause: Cause | None = None
    touched: bool = True
    step_s: float = 0.0
    beyond_hz: float | None = None

    @property
    def hold_s(self) -> float:
        """How long the pulse was looked at [s]."""
        return float(len(self.pulse.fit.residual_pa) * self.step_s) if self.pulse else 0.0

    @property
    def level_pa(self) -> float:
        return self.pulse.baseline_pa if self.pulse else float("nan")

    @property
    def size_pa(self) -> float:
        return self.pulse.size_pa if self.pulse else float("nan")


def presses_of(recording: Recording, false_alarm: float) -> tuple[Press, ...]:
    """All stations of a recording, in its order.

    Where a pulse passes at ``false_alarm`` for the whole recording, every station's is measured at
    that heart's rate; p-values stay those of each station's own search.
    """
    dead = dead_channels(recording.stations)
    out = [name for name, gone in zip(recording.channels, dead, strict=False) if gone]
    alone, measured, beating = _found(recording, dead, false_alarm)
    pulsing, causes = beating.stations, beating.causes
    others = {} if pulsing or causes else _beyond(measured, false_alarm)
    asked = {i: beats_of(measured[i][0], train) for i, train in beating.trains.items()}
    heart = heart_of([(*measured[i], asked.get(i)) for i in pulsing])
    pulses = _sized([
        pulse_at(own.hold, own.clearest, heart, i in pulsing, asked.get(i))
        if own.hold and own.clearest else None
        for i, own in enumerate(alone)
    ])  # fmt: skip
    if heart is not None:
        pulses = _barely_seen(alone, pulses)
    return tuple(
        replace(
            _press(station, own.hold, _with_level(own, pulse), _noted(own.note, out)),
            pulsing=i in pulsing, cause=causes.get(i), touched=own.touched,
            step_s=own.hold.step_s if own.hold else 0.0, beyond_hz=others.get(i),
        )
        for i, (station, own, pulse) in enumerate(
            zip(recording.stations, alone, pulses, strict=True)
        )
    )  # fmt: skip


def _found(
    recording: Recording, dead: Bools, false_alarm: float
) -> tuple[list["_Own"], dict[int, tuple[Hold, Clearest]], Beating]:
    """Every station by its reference, or by itself where that beats otherwise; those that can be
    judged; and which of these pulse."""
    by_reference = _each(recording, dead)
    measured = _measured(by_reference)
    beating = which_pulse(measured, recording, false_alarm)
    referred = {i: hold for i, (hold, clearest) in measured.items() if clearest.search is None}
    if not referred:
        return by_reference, measured, beating
    priors = dict(zip(referred, noise_priors(list(referred.values())), strict=True))
    alone = [
        _searched(referred[i], priors[i], CONTRADICTED) if i in referred else own
        for i, own in enumerate(by_reference)
    ]
    by_itself = _measured(alone)
    other = which_pulse(by_itself, recording, false_alarm)
    both = ((*measured[i], by_itself[i][1]) for i in other.stations if i in referred)
    return (alone, by_itself, other) if contradicted(both) else (by_reference, measured, beating)


def _measured(each: Sequence["_Own"]) -> dict[int, tuple[Hold, Clearest]]:
    return {
        i: (own.hold, own.clearest)
        for i, own in enumerate(each)
        if own.hold is not None and own.clearest is not None
    }


def _also(note: str, more: str) -> str:
    return f"{note}; {more}" if note else more


def _noted(note: str, out: Sequence[str]) -> str:
    if not out:
        return note
    names = ", ".join(out[:MOST_NAMED])
    more = f" and {len(out) - MOST_NAMED} more" if len(out) > MOST_NAMED else ""
    return _also(note, f"dead or stuck, left out everywhere: {names}{more}")


def _beyond(measured: dict[int, tuple[Hold, Clearest]], false_alarm: float) -> dict[int, float]:
    """Stations in which something beats at a rate where no pulse is looked for [Hz]."""
    rates = {i: beyond(hold) for i, (hold, _) in measured.items()}
    return {i: rate for i, (rate, chance) in rates.items() if chance * len(rates) <= false_alarm}


@dataclass(frozen=True)
class _Own:
    """A station by itself; ``whole`` is its whole hold where only a part is judged."""

    hold: Hold | None
    clearest: Clearest | None
    note: str = ""
    touched: bool = True
    whole: Hold | None = None


def _each(recording: Recording, dead: Bools) -> list["_Own"]:
    """Every station by its reference, or else by its own search in the noise that all share."""
    holds: dict[int, Hold] = {}
    by_station: dict[int, _Own] = {}
    for i, station in enumerate(recording.stations):
        try:
            read = within_steps(unrounded(hold_of(station, dead)), station.index)
            hold = least_noise(read, station.index)
        except NoHold as error:
            by_station[i] = _Own(None, None, str(error), not isinstance(error, NoContact))
            continue
        beats_s = station.reference_s - hold.start_s
        own = find_pulse_by(hold, beats_s, station.reference) if len(station.reference) else None
        if own is None:
            holds[i] = hold
        else:
            by_station[i] = _Own(hold, own)
    for (i, hold), prior in zip(holds.items(), noise_priors(list(holds.values())), strict=True):
        unread = len(recording.stations[i].reference) > 0
        note = "its reference has no beats: judged without it" if unread else ""
        by_station[i] = _searched(hold, prior, note)
    return [by_station[i] for i in range(len(recording.stations))]


def _searched(hold: Hold, prior: Prior, note: str = "") -> _Own:
    part, clearest = clearest_part(hold, prior)
    if part is hold:
        return _Own(hold, clearest, note)
    other = "first" if part.time_s[0] > hold.time_s[0] else "second"
    moved = f"something moves in the {other} half of its hold: its pulse is that of the other"
    return _Own(part, clearest, _also(note, moved), whole=hold)


def _with_level(own: _Own, pulse: Pulse | None) -> Pulse | None:
    """With the level of the whole hold, so that presses of relaxing tissue compare."""
    if pulse is None or own.whole is None:
        return pulse
    level = fit(own.whole, design_of(own.whole), np.empty((len(own.whole.time_s), 0)))
    return replace(
        pulse, baseline_pa=float(level.rest_pa.mean()), baseline_sd_pa=level.rest_mean_sd_pa
    )


def _sized(pulses: list[Pulse | None]) -> list[Pulse | None]:
    """With sizes by what all presses say of relaxation and heart."""
    evidence = iter(together([pulse.sizes for pulse in pulses if pulse is not None]))

    def sized(pulse: Pulse) -> Pulse:
        size_pa, size_sd_pa = averaged(pulse.sizes, next(evidence))
        return replace(pulse, size_pa=size_pa, size_sd_pa=size_sd_pa)

    return [pulse and sized(pulse) for pulse in pulses]


def _press(station: Station, hold: Hold | None, pulse: Pulse | None, note: str) -> Press:
    if hold is None or pulse is None:
        return Press(station, None, float("nan"), 1.0 if "clipped" in note else 0.0, note)
    deep_m = station.hold_depth_m
    share = STIFFENING * REPEATABILITY_M / deep_m if deep_m > 0 else UNKNOWN_DEPTH
    scatter = float(np.hypot(pulse.baseline_sd_pa, share * abs(pulse.baseline_pa)))
    notes = [note] if note else []
    if pulse.baseline_pa < 0:
        notes.append("its mean force is negative: check the sign, or tare in air")
    if hold.clipped > 0:
        notes.append(f"{100 * hold.clipped:.0f} % of its samples are clipped: press less deep")
    if hold.lost >= LEAST_LOST:
        lost = f"{100 * hold.lost:.0f} % of its samples"
        notes.append(f"{lost} are missing, behind a gap, or one reading repeated")
    if hold.outliers:
        readings = "1 reading" if hold.outliers == 1 else f"{hold.outliers} readings"
        notes.append(f"{readings} of its hold, far off those around, left out")
    return Press(station, pulse, scatter, hold.clipped, "; ".join(notes))


def _barely_seen(each: list[_Own], pulses: list[Pulse | None]) -> list[Pulse | None]:
    """With the doubt of holds of less than `LEAST_BEAT`: their pulse may be any of the scan's."""
    largest_pa = max(pulse.size_pa for pulse in pulses if pulse is not None)

    def doubted(own: _Own, pulse: Pulse | None) -> Pulse | None:
        if pulse is None or own.hold is None or own.hold.span_s * pulse.rate_hz >= LEAST_BEAT:
            return pulse
        return replace(pulse, size_sd_pa=float(np.hypot(pulse.size_sd_pa, largest_pa)))

    return [doubted(own, pulse) for own, pulse in zip(each, pulses, strict=True)]


def chance_of_pulse(presses: Iterable[Press]) -> float | None:
    """Posterior probability that what moves in them is a pulse, None where nothing does."""
    pulsing = [press for press in presses if press.pulsing]
    asked = [press.cause.pulse for press in pulsing if press.cause is not None]
    return max(asked, default=stated(1.0)) if pulsing else None
