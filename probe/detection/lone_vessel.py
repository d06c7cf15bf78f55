"""A pulse without a row of stations: a vessel, and out of tissue whether it is stenosed."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.special import logsumexp

from drivers.core.arrays import Array
from probe.core.finding_words import NORMAL_95, percent, plain
from probe.detection.classify.classifier import MIN_POSTERIOR, PULSE_BLUR, PULSE_FLOOR
from probe.detection.classify.single_press import VESSELS, WORLDS, apparent_modulus_pa, vessels
from probe.detection.finding import Kind, ObjectFinding, stated
from probe.detection.map.bumps import MIN_STATIONS
from probe.detection.map.row_shapes import shape
from probe.detection.pulse.presses import Press
from probe.detection.repeats import MIN_NAMED, distinct_m, pitch_m

MORE = f"a row of {MIN_NAMED} stations over it, or presses beside it that meet nothing"
ASIDE_MM, FELT_MM = (0.0, 3.0, 6.0, 9.0, 12.0), 5.0
"""How far beside a vessel in tissue a press may be to feel it, and half of its pulse's width:
between those of TIHA and of the solved blocks."""
MIN_OF_ONE = 0.95
"""Least posterior probability of a kind to name it by one press. Left out one by one, of 480
solved presses over and 6 mm beside vessels 265 are named rightly and 1 wrongly."""
MIN_HOLD_S = 4.5
"""In a hold of 5 s 0 to 3 % of each kind of artefact are called an artery, in one of 2.5 s up to
44 % of breaths (benchmarks/artefacts.py); holds between were not measured."""
MODULUS_BLUR = 0.3
"""Width of a sample's kernel in the logarithm of the apparent modulus. Solved fingers are 10 mm
long: one of 5 or 20 mm moves it by 0.35."""
BEYOND = 10.0
"""How many times softer or stiffer than every solved vessel a press may be to be compared with
them: forces in another unit are a thousand times off."""


def lone_vessel(presses: tuple[Press, ...], rows: list[list[int]]) -> ObjectFinding | None:
    """A vessel out of tissue: fewer presses than a row met it, those beside it met nothing.

    Healthy or stenotic is decided by its pulse over its force, against solved vessels that lie on a
    flat support: a stenosis holds the lumen open and hides nine tenths of the pulse. None where
    nothing beside it is empty, or where it does not pulse.
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
    assert above.pulse is not None
    pulse = above.size_pa / above.level_pa, above.pulse.size_sd_pa / above.level_pa
    share = shares(*pulse)
    best = max(VESSELS, key=lambda kind: share[kind])
    place = float(np.average(x_m, weights=level)) if level.sum() > 0 else above.station.x_m
    ends = beside(place, [presses[i] for i in row])
    chance = share[best] * _pulse(above)
    if chance < MIN_POSTERIOR:
        chances = ", ".join(f"{k} {percent(v)}" for k, v in share.items())
        return ObjectFinding(
            "undecided", place, ends, above.level_pa, above.size_pa,
            stated(chance), f"a vessel out of tissue, between {chances}: hold for more beats",
            chances=share, pulse_share=pulse,
        )  # fmt: skip
    return ObjectFinding(
        best, place, ends, above.level_pa, above.size_pa, stated(chance),
        "it pulses and nothing lies beside it: a vessel out of tissue, judged by its pulse over "
        f"its force ({100 * above.size_pa / above.level_pa:.2g} %)",
        chances=share, pulse_share=pulse,
    )  # fmt: skip


def shares(
    pulse: float, pulse_sd: float, modulus_pa: float = float("nan"),
    worlds: Sequence[str] = ("alone",),
) -> dict[str, float]:  # fmt: skip
    """Posterior probability of each kind of vessel in any of ``worlds``, all alike beforehand,
    given its pulse over its force and, where it is known, the apparent modulus under the finger."""
    size = max(pulse, PULSE_FLOOR)
    blur = float(np.hypot(PULSE_BLUR, min(pulse_sd / size, 2.0)))
    score: dict[str, float] = {}
    for kind in _solved()[worlds[0]]:
        each = []
        for world in worlds:
            off = (np.log(size) - _solved()[world][kind][:, 0]) / blur
            square = off**2
            if np.isfinite(modulus_pa):
                stiff = (np.log(modulus_pa) - _solved()[world][kind][:, 1]) / MODULUS_BLUR
                square = square + stiff**2
            each.append(logsumexp(-0.5 * square) - np.log(len(square)))
        score[kind] = float(logsumexp(each))
    whole = float(logsumexp(list(score.values())))
    return {kind: float(np.exp(value - whole)) for kind, value in score.items()}


def pulsing_place(
    presses: tuple[Press, ...], unfinished: bool, face_m2: float
) -> list[ObjectFinding]:
    """The one object that a pulse alone can show, where no row does: a vessel.

    It lies where the pulse is largest, or beside any press whose pulse may be as large; where that
    is an end of what was scanned, up to `ASIDE_MM` beyond it. A press of known place and depth
    compares with the solved vessels, in tissue and out of it. Of a recording that decides neither,
    an artery is a vessel, healthy or not.
    """
    pulsing = [p for p in presses if p.pulsing and p.pulse is not None]
    if not pulsing:
        return []
    strongest = max(pulsing, key=lambda p: p.size_pa)
    x_m = strongest.station.x_m
    around = [beside(p.station.x_m, presses) for p in pulsing if _as_strong(p, strongest)]
    ends = min(low for low, _ in around), max(high for _, high in around)
    kind, sure, reason, chances = _vessel(strongest, face_m2)
    every, aside_m = [p.station.x_m for p in presses], 1e-3 * ASIDE_MM[-1]
    if not unfinished and np.ptp(every) > 0 and x_m in (min(every), max(every)):
        low, high = ends
        ends = (x_m - aside_m, high) if x_m == min(every) else (low, x_m + aside_m)
        reason += "; it pulses most where the stations end, and lies here or beyond"
    if strongest.hold_s < MIN_HOLD_S:
        reason += (
            f"; in a hold as short as {strongest.hold_s:.1f} s breathing, tremor or a hand that "
            "moves may pass for a pulse"
        )
    if unfinished and np.isfinite(ends[0]):
        last_m = max(presses, key=lambda p: p.station.index).station.x_m
        where = (
            ": what pulses lies here or beyond the last station so far" if last_m in ends else ""
        )
        kind, reason = "undecided", f"the row is not finished{where}; {reason}"
    return [ObjectFinding(
        kind, x_m, ends, float("nan"), strongest.size_pa, stated(sure), reason, chances=chances,
        pulse_share=_pulse_share(strongest),
    )]  # fmt: skip


def _pulse_share(press: Press) -> tuple[float, float] | None:
    """Pulse over force, with its standard deviation; None without a force above zero."""
    if press.pulse is None or press.level_pa <= 0:
        return None
    return press.size_pa / press.level_pa, press.pulse.size_sd_pa / press.level_pa


def _as_strong(one: Press, strongest: Press) -> bool:
    """Whether the sizes of two pulses differ by no more than their errors leave open (95 %)."""
    assert one.pulse is not None and strongest.pulse is not None  # both pulse
    doubt_pa = np.hypot(one.pulse.size_sd_pa, strongest.pulse.size_sd_pa)
    return bool(strongest.size_pa - one.size_pa <= NORMAL_95 * doubt_pa)


def beside(x_m: float, presses: Sequence[Press]) -> tuple[float, float]:
    """What lies between the presses next to a place: a pitch to either side, within what was
    scanned. NaN of one place."""
    every = np.array([p.station.x_m for p in presses])
    pitch = pitch_m(every)
    if np.isnan(pitch):
        return float("nan"), float("nan")
    return max(x_m - pitch, float(np.nanmin(every))), min(x_m + pitch, float(np.nanmax(every)))


def _vessel(press: Press, face_m2: float) -> tuple[Kind, float, str, dict[str, float]]:
    """What a press that pulses by itself is called, how likely it is so, why, and the chances of
    both kinds: by the pulse alone where its stiffness is unknown."""
    deep_m, pulse = press.station.hold_depth_m, _pulse_share(press)
    if pulse is None or not np.isfinite(press.station.x_m) or not deep_m > 0:
        share = shares(*pulse, worlds=WORLDS) if pulse else {}
        reason = f"it pulses; whether it is stenosed needs {MORE}"
        return "artery", _pulse(press), reason, share
    modulus_pa = apparent_modulus_pa(press.level_pa, face_m2, deep_m)
    softest_pa, stiffest_pa = _solved_moduli_pa()
    if not softest_pa / BEYOND < modulus_pa < stiffest_pa * BEYOND:
        return "undecided", _pulse(press), (
            f"it pulses on what is {plain(1e-3 * modulus_pa, 2)} kPa stiff under the finger, where "
            f"solved vessels have {1e-3 * softest_pa:.0f} to {1e-3 * stiffest_pa:.0f}: check the "
            "sensor's scale and unit, and face_mm2"
        ), {}  # fmt: skip
    share = shares(*pulse, modulus_pa, WORLDS)
    best = max(VESSELS, key=lambda kind: share[kind])
    sure = share[best] * _pulse(press)
    by = f"{best} is likeliest, {percent(stated(sure))} by pulse and stiffness of one press"
    if sure < MIN_OF_ONE:
        reason = f"it pulses; {by}; to decide it needs {MORE}"
        return "undecided", sure, reason, share
    return best, sure, f"it pulses; {by}", share


def _pulse(press: Press) -> float:
    """Posterior probability that what moves is a pulse; a reference beside it makes it one."""
    if press.cause is not None:
        return press.cause.pulse
    return 1 - min(1.0, press.pulse.p_value) if press.pulse else 0.0


def _solved_moduli_pa() -> tuple[float, float]:
    """The least and the greatest apparent modulus of all solved vessels."""
    every = np.concatenate([rows[:, 1] for kinds in _solved().values() for rows in kinds.values()])
    return float(np.exp(every.min())), float(np.exp(every.max()))


@lru_cache(maxsize=1)
def _solved() -> dict[str, dict[Kind, Array]]:
    """Logarithms of pulse and apparent modulus (n, 2), by world and kind. One press does not know
    whether it is above a vessel in tissue: beside it the pulse is smaller."""
    share = shape(np.array(ASIDE_MM), 0.0, FELT_MM)
    found: dict[str, dict[Kind, Array]] = {}
    for world, kinds in vessels().items():
        found[world] = {}
        for kind, rows in kinds.items():
            seen = share if world == "tissue" else np.ones(1)
            pulse = np.maximum(np.outer(rows[:, 0], seen), PULSE_FLOOR).ravel()
            found[world][kind] = np.log(np.column_stack([pulse, rows[:, 1].repeat(len(seen))]))
    return found
