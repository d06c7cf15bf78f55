"""Two scans beside each other: what lies in both, and what changed.

`probe.detection.detect` says what each scan shows. Objects are matched by place. Forces depend on
the tissue and are not compared: a vessel is judged in its own scan, by contrast and pulse over
force, and a lump by its contrast.
"""

from dataclasses import dataclass
from math import exp, hypot, isfinite, isnan, nan
from os import PathLike

import numpy as np

from drivers.core.arrays import Array
from probe.core.finding_words import NORMAL_95, percent
from probe.core.recording import Recording
from probe.detection.classify.kinds import MIN_POSTERIOR
from probe.detection.finding import (
    HEALTHY,
    LUMP,
    NARROWED,
    UNDECIDED,
    VESSELS,
    Comparison,
    Diseased,
    Finding,
    ObjectFinding,
    ObjectPair,
    stated,
)
from probe.detection.map.bumps import MIN_DISTANCE
from probe.detection.repeats import pitch_m
from probe.detection.scan import detect
from probe.detection.sizes import NAMES
from probe.storage.run import recording_of

SAME_PRESS = 0.05
"""Difference of depth or face, over the mean, up to which contrasts of two scans compare."""


@dataclass(frozen=True)
class _Scan:
    recording: Recording
    finding: Finding

    @property
    def pitch_m(self) -> float:
        return pitch_m(np.array([station.x_m for station in self.finding.stations]))

    def station_at(self, thing: ObjectFinding) -> tuple[float, float]:
        """Level and pulse [Pa] of the station nearest to an object."""
        judged = [s for s in self.finding.stations if isfinite(s.baseline_pa)]
        if isnan(thing.position_m) and len(judged) > 1:
            judged = [max(judged, key=lambda s: s.pulse_pa)]
        near = min(judged, key=lambda s: abs(s.x_m - thing.position_m) if len(judged) > 1 else 0.0)
        return near.baseline_pa, near.pulse_pa if isnan(near.pulse_below_pa) else nan

    @property
    def press(self) -> Array:
        """Depth [m] of the usual press and face [m2]."""
        deep_m = [station.hold_depth_m for station in self.recording.stations]
        return np.array([np.nanmedian(deep_m) if np.isfinite(deep_m).any() else nan,
                         self.recording.face_m2])  # fmt: skip


def compare(a: Recording | str | PathLike[str], b: Recording | str | PathLike[str]) -> Comparison:
    """What two scans of one place have in common, and what changed from ``a`` to ``b``.

    ``a`` and ``b`` are recordings, runs or run files. ``diseased`` names the scan in which a vessel
    is stenosed that is not in the other; ``neither`` if no vessel is, or none more than the other;
    ``undecided`` if there is nothing to compare, or the scans do not say.

    Parameters
    ----------
    a
        A recording, a run or a run file.
    b
        The other one.

    Returns
    -------
    Comparison
        What differs, and how sure that is.

    Raises
    ------
    RunFileError
        The file cannot be read, or is no run.

    Examples
    --------
    >>> import palpate
    >>> recording = palpate.open_run("TIHA.run").recording()
    >>> palpate.compare(recording, recording).reason  # of one scan with itself
    'both show an artery, and neither is stenosed'
    """
    scans = [_Scan(recording, detect(recording)) for recording in map(recording_of, (a, b))]
    for which, scan in zip("AB", scans, strict=True):
        if any(s.baseline_pa <= 0 for s in scan.finding.stations):
            return _unknown(
                f"scan {which} reads no force above zero where it presses, so that stiffness does "
                "not compare: turn its sign, or take the zero in the air"
            )
    pairs = _pairs(*scans)
    if not any(pair.a and pair.b for pair in pairs):
        said = [_only_one(pair) for pair in pairs] or ["neither scan shows anything"]
        return _unknown("; ".join(said) + ": nothing to compare", pairs)
    judged = [(_judged(pair, scans), pair) for pair in pairs if pair.a and pair.b]
    order = [("A", "B"), (UNDECIDED,), ("neither",)]  # what a person would act on comes first
    (diseased, confidence, _), main = next(
        verdict for names in order for verdict in judged if verdict[0][0] in names
    )
    reasons = [said[2] for said, _ in judged] + [_only_one(p) for p in pairs if not (p.a and p.b)]
    ratios = _ratios(main, scans) if diseased != UNDECIDED else (nan, nan)
    return Comparison(diseased, *ratios, stated(confidence), "; ".join(reasons), tuple(pairs))


def _unknown(reason: str, pairs: list[ObjectPair] | None = None) -> Comparison:
    return Comparison(UNDECIDED, nan, nan, 0.0, reason, tuple(pairs or ()))


def _pairs(a: _Scan, b: _Scan) -> list[ObjectPair]:
    """Objects of both scans, the nearest ones first, as far as they may be one; then single ones.

    One vessel in each scan is a pair wherever it lies: two arms do not lie alike.
    """
    rest_a, rest_b = list(a.finding.objects), list(b.finding.objects)
    pitches = [p for p in (a.pitch_m, b.pitch_m) if isfinite(p)]
    reach_m = MIN_DISTANCE * max(pitches, default=0.0)
    distances = sorted(
        ((_apart_m(x, y), i, j) for i, x in enumerate(rest_a) for j, y in enumerate(rest_b)),
    )
    matched: list[tuple[ObjectFinding, ObjectFinding]] = []
    for apart_m, i, j in distances:
        x, y = a.finding.objects[i], b.finding.objects[j]
        if x in rest_a and y in rest_b and apart_m <= reach_m + hypot(_reach_m(x), _reach_m(y)):
            matched.append((x, y))
            rest_a.remove(x)
            rest_b.remove(y)
    vessels = [[thing for thing in rest if thing.is_vessel] for rest in (rest_a, rest_b)]
    if not matched and len(vessels[0]) == len(vessels[1]) == 1:
        matched = [(vessels[0][0], vessels[1][0])]
        rest_a.remove(vessels[0][0])
        rest_b.remove(vessels[1][0])
    return [
        *(ObjectPair(x, y, _changes(x, y)) for x, y in matched),
        *(ObjectPair(x, None) for x in rest_a),
        *(ObjectPair(None, y) for y in rest_b),
    ]


def _apart_m(x: ObjectFinding, y: ObjectFinding) -> float:
    """How far two objects lie apart; 0 where a place is unknown."""
    if isnan(x.position_m) or isnan(y.position_m):
        return 0.0
    if len(x.course) == len(y.course) == 1:
        return float(np.hypot(*(np.array(x.course[0]) - y.course[0])))
    return abs(x.position_m - y.position_m)


def _reach_m(thing: ObjectFinding) -> float:
    low_m, high_m = thing.position_ci_m
    return (high_m - low_m) / 2 if isfinite(high_m - low_m) else 0.0


def _changes(a: ObjectFinding, b: ObjectFinding) -> dict[str, tuple[float, float, float]]:
    """Of contrast, pulse over force, and of what `Sizes` has, where both are known: B
    over A less 1, and its interval."""
    both = {
        "contrast": (a.contrast, b.contrast), "pulse_share": (a.pulse_share, b.pulse_share),
        **{name: (a.sizes.spread(name), b.sizes.spread(name)) for name in NAMES},
    }  # fmt: skip
    changed = {}
    for name, (first, second) in both.items():
        if first and second and min(first[0], second[0]) > 0:
            ratio = second[0] / first[0]
            reach = NORMAL_95 * hypot(first[1] / first[0], second[1] / second[0])
            changed[name] = (ratio - 1, ratio * exp(-reach) - 1, ratio * exp(reach) - 1)
    return changed


def _judged(pair: ObjectPair, scans: list[_Scan]) -> tuple[Diseased, float, str]:
    a, b = pair.a, pair.b
    assert a is not None and b is not None
    kinds = {a.kind, b.kind}
    still = all(thing.chances.get(HEALTHY, 1.0) <= 1 - MIN_POSTERIOR for thing in (a, b))
    if LUMP in kinds and kinds <= {LUMP, UNDECIDED} and still:
        return _lumps(pair, scans)
    if min(_vessel(a), _vessel(b)) < MIN_POSTERIOR:
        return UNDECIDED, 0.0, f"A shows {_what(a)}, B {_what(b)}: nothing to compare"
    sick_a, sick_b = (thing.chances[NARROWED] / _vessel(thing) for thing in (a, b))
    only: dict[Diseased, float] = {
        "A": sick_a * (1 - sick_b), "B": (1 - sick_a) * sick_b
    }  # fmt: skip
    chances = only | {"neither": 1 - only["A"] - only["B"]}
    best = max(chances, key=lambda name: chances[name])
    if chances[best] < MIN_POSTERIOR:
        said = ", ".join(f"{name} {percent(stated(p))}" for name, p in chances.items())
        return UNDECIDED, chances[best], f"whether only one vessel is stenosed is open: {said}"
    if best != "neither":
        other = "B" if best == "A" else "A"
        return best, chances[best], f"{best}'s vessel is stenosed, {other}'s is not"
    both = "both are stenosed" if sick_a > 0.5 else "neither is stenosed"
    return best, chances[best], f"both show an artery, and {both}"


def _vessel(thing: ObjectFinding) -> float:
    """Probability that an object is a vessel."""
    return sum(thing.chances.get(kind, 0.0) for kind in VESSELS)


def _lumps(pair: ObjectPair, scans: list[_Scan]) -> tuple[Diseased, float, str]:
    a, b = pair.a, pair.b
    assert a is not None and b is not None
    sure = a.confidence * b.confidence
    depth, face = (2 * abs(x - y) / (x + y) for x, y in zip(*(s.press for s in scans), strict=True))
    where = f"the lump at x = {1e3 * a.position_m:.1f} mm" if isfinite(a.position_m) else "the lump"
    if max(depth, face) > SAME_PRESS:
        return "neither", sure, (
            f"{where} is in both, but they were pressed to other depths or with other faces: press "
            "both alike to see whether it grew"
        )  # fmt: skip
    if "contrast" not in pair.change:
        return "neither", sure, f"{where} is in both; no contrast is known that could be compared"
    value, low, high = (100 * part for part in pair.change["contrast"])
    interval = f"{value:+.0f} % (95 %: {low:+.0f} to {high:+.0f})"
    if not isnan(a.sizes.diameter_m + b.sizes.diameter_m):
        interval += (
            f"; diameter {1e3 * a.sizes.diameter_m:.3g} mm in A, {1e3 * b.sizes.diameter_m:.3g} mm "
            "in B"
        )
    if low > 0:
        return "neither", sure, f"{where} is larger or harder in B: contrast {interval}"
    if high < 0:
        return "neither", sure, f"{where} is smaller or softer in B: contrast {interval}"
    return "neither", sure, f"{where} is no different: contrast {interval}"


def _what(thing: ObjectFinding) -> str:
    if not thing.is_named:
        return "something undecided"
    return f"{'an' if thing.kind == HEALTHY else 'a'} {thing.kind}"


def _only_one(pair: ObjectPair) -> str:
    thing = pair.a or pair.b
    assert thing is not None
    which, other = ("A", "B") if pair.a else ("B", "A")
    where = f" at x = {1e3 * thing.position_m:.1f} mm" if isfinite(thing.position_m) else ""
    return f"only {which} shows {_what(thing)}{where}, {other} nothing there"


def _ratios(pair: ObjectPair, scans: list[_Scan]) -> tuple[float, float]:
    """Force and pulse at the objects' stations, A over B; NaN where either is not above zero."""
    assert pair.a is not None and pair.b is not None
    above, below = scans[0].station_at(pair.a), scans[1].station_at(pair.b)
    level, pulse = (x / y if min(x, y) > 0 else nan for x, y in zip(above, below, strict=True))
    return level, pulse
