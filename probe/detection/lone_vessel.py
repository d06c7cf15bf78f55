"""A pulse without a row of stations: a vessel, and out of tissue whether it is stenosed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from probe.core.finding_words import NORMAL_95, percent
from probe.detection.classify.kinds import Judged, Seen, judge
from probe.detection.classify.population import BESIDE_MM, World, apparent_modulus_pa
from probe.detection.finding import HEALTHY, UNDECIDED, ObjectFinding, stated
from probe.detection.map.bumps import MIN_STATIONS
from probe.detection.pulse.presses import Press
from probe.detection.repeats import MIN_NAMED, distinct_m, pitch_m

MORE = f"a row of {MIN_NAMED} stations over it, or presses beside it that meet nothing"
MIN_HOLD_S = 4.5
"""In a hold of 5 s 0 to 3 % of each kind of artefact are called an artery, in one of 2.5 s up to
44 % of breaths (benchmarks/artefacts.py); holds between were not measured."""


def lone_vessel(
    presses: tuple[Press, ...], rows: list[list[int]], face_m2: float
) -> ObjectFinding | None:
    """A vessel out of tissue: fewer presses than a row met it, those beside it met nothing.

    None where nothing beside it is empty, or where it does not pulse.
    """
    row = next((r for r in rows if any(not presses[i].touched for i in r)
                and any(presses[i].pulsing for i in r)), None)  # fmt: skip
    if row is None:
        return None
    met = [presses[i] for i in row if presses[i].pulse is not None]
    x_m = np.array([p.station.x_m for p in met])
    if len(distinct_m(x_m)) >= MIN_STATIONS:
        return None
    level = np.array([max(p.level_pa, 0.0) for p in met])
    above = met[int(np.argmax(level))]
    place_m = float(np.average(x_m, weights=level)) if level.sum() > 0 else above.station.x_m
    ends_m = beside(place_m, [presses[i] for i in row])
    said = _judged(above, face_m2, ("alone",), "hold for more beats")
    if said is None:
        return None
    why = said.reason or (
        f"it pulses and nothing lies beside it, {100 * above.size_pa / above.level_pa:.2g} % of "
        "its force"
    )
    return _found(above, place_m, ends_m, above.level_pa, said, f"a vessel out of tissue: {why}")


def pulsing_place(
    presses: tuple[Press, ...], unfinished: bool, face_m2: float
) -> list[ObjectFinding]:
    """The one object that a pulse alone can show, where no row does: a vessel.

    It lies where the pulse is largest, or beside any press whose pulse may be as large; where that
    is an end of what was scanned, up to `BESIDE_MM` beyond it. A press of known place and depth
    compares with the solved vessels, in tissue and out of it. Of a recording that says neither, an
    artery is a vessel, healthy or not.
    """
    pulsing = [p for p in presses if p.pulsing and p.pulse is not None]
    if not pulsing:
        return []
    strongest = max(pulsing, key=lambda p: p.size_pa)
    x_m = strongest.station.x_m
    around = [beside(p.station.x_m, presses) for p in pulsing if _as_strong(p, strongest)]
    ends = min(low for low, _ in around), max(high for _, high in around)
    said = _judged(strongest, face_m2, ("beside", "alone"), f"to decide it needs {MORE}")
    known = np.isfinite(x_m) and strongest.station.hold_depth_m > 0
    if said is None or not known:
        unknown = f"whether it is stenosed needs {MORE}"
        chances = said.chances if said else {}
        said = Judged(HEALTHY, _is_pulse(strongest), unknown, float("nan"), chances=chances)
    elif said.kind != UNDECIDED:
        sure = percent(said.confidence)
        said = replace(said, reason=f"probably {said.kind} ({sure}, by one press)")
    reason = f"it pulses; {said.reason}"
    scanned_m, aside_m = [p.station.x_m for p in presses], 1e-3 * BESIDE_MM
    if not unfinished and np.ptp(scanned_m) > 0 and x_m in (min(scanned_m), max(scanned_m)):
        low, high = ends
        ends = (x_m - aside_m, high) if x_m == min(scanned_m) else (low, x_m + aside_m)
        reason += "; it pulses most where the stations end, and lies here or beyond"
    if strongest.hold_s < MIN_HOLD_S:
        reason += (
            f"; in a hold of {strongest.hold_s:.1f} s breathing, tremor or motion can look like a "
            "pulse"
        )
    if unfinished and np.isfinite(ends[0]):
        last_m = max(presses, key=lambda p: p.station.index).station.x_m
        where = (
            ": what pulses lies here or beyond the last station so far" if last_m in ends else ""
        )
        said = replace(said, kind=UNDECIDED)
        reason = f"the row is not finished{where}; {reason}"
    return [_found(strongest, x_m, ends, float("nan"), said, reason)]


def _judged(press: Press, face_m2: float, worlds: Sequence[World], advice: str) -> Judged | None:
    """What a press that pulses is by itself; None without a force above zero."""
    if press.pulse is None or press.level_pa <= 0:
        return None
    deep_m = press.station.hold_depth_m
    return judge(
        Seen(
            press.size_pa / press.level_pa, press.pulse.size_sd_pa / press.level_pa,
            modulus_pa=apparent_modulus_pa(press.level_pa, face_m2, deep_m)
            if deep_m > 0 else float("nan"),
            worlds=worlds, moving=_is_pulse(press),
        ),
        advice,
    )  # fmt: skip


def _found(
    press: Press, x_m: float, ends_m: tuple[float, float], peak_pa: float, said: Judged, reason: str
) -> ObjectFinding:
    share = None
    if press.pulse is not None and press.level_pa > 0:
        share = press.size_pa / press.level_pa, press.pulse.size_sd_pa / press.level_pa
    return ObjectFinding(
        said.kind, x_m, ends_m, peak_pa, press.size_pa, stated(said.confidence), reason,
        p_stiff=said.stiff, chances=said.chances, pulse_share=share,
    )  # fmt: skip


def _as_strong(press: Press, strongest: Press) -> bool:
    """Whether the sizes of two pulses differ by no more than their errors leave open (95 %)."""
    assert press.pulse is not None and strongest.pulse is not None  # both pulse
    doubt_pa = np.hypot(press.pulse.size_sd_pa, strongest.pulse.size_sd_pa)
    return bool(strongest.size_pa - press.size_pa <= NORMAL_95 * doubt_pa)


def beside(x_m: float, presses: Sequence[Press]) -> tuple[float, float]:
    """What lies between the presses next to a place: a pitch to either side, within what was
    scanned. NaN of one place."""
    scanned_m = np.array([p.station.x_m for p in presses])
    pitch = pitch_m(scanned_m)
    if np.isnan(pitch):
        return float("nan"), float("nan")
    return max(x_m - pitch, float(np.nanmin(scanned_m))), min(
        x_m + pitch, float(np.nanmax(scanned_m))
    )


def _is_pulse(press: Press) -> float:
    """Posterior probability that what moves is a pulse; a reference beside it makes it one."""
    if press.cause is not None:
        return press.cause.pulse
    return 1 - min(1.0, press.pulse.p_value) if press.pulse else 0.0
