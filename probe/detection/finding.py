"""The result of detection: the finding of a scan, and of two scans compared."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite, nan
from typing import Any, Final, Literal

from probe.core.finding_words import summary
from probe.core.recording import Recording
from probe.detection.priors import DEFAULT, Priors
from probe.detection.sizes import Sizes
from sim_backend import html

Kind = Literal["nothing", "tumour", "artery", "stenotic artery", "undecided", "cannot see"]
Diseased = Literal["A", "B", "neither", "undecided"]
UNDECIDED: Final = "undecided"
HEALTHY: Final = "artery"
NARROWED: Final = "stenotic artery"
LUMP: Final = "tumour"
VESSELS: tuple[Kind, ...] = (HEALTHY, NARROWED)
NAMED: tuple[Kind, ...] = (NARROWED, HEALTHY, LUMP)
"""Kinds of an object; first the one that a person would act on."""

MAX_CONFIDENCE = 0.999
"""No model of the world is surer of itself than this, whatever its likelihoods say."""


DECIMALS = 6
"""Of a place in mm: a nanometre, which leaves 36.00000000000001 out."""


def stated(confidence: float) -> float:
    """A posterior probability as it is reported: at most `MAX_CONFIDENCE`."""
    return min(max(confidence, 0.0), MAX_CONFIDENCE)


@dataclass(frozen=True)
class StationFinding:
    """One press: mean stress over the hold without the pulse, and the pulse from trough to crest.

    ``station`` is its number from 1, as everywhere that people read one. NaN where a press gave
    nothing to judge by; ``note`` then says why. ``clipped`` is the share of samples lost to
    saturation. ``rate_hz`` is the pulse's, NaN where none was found. Where noise alone may
    have made ``pulse_pa``, a pulse is below ``pulse_below_pa`` (97.5 %); NaN elsewhere.

    Examples
    --------
    >>> import palpate
    >>> found = palpate.detect("TIHA.run")
    >>> strongest = max(found.stations, key=lambda station: station.pulse_pa)
    >>> strongest.x_m, strongest.clipped
    (0.032, 0.0)
    """

    station: int
    x_m: float
    y_m: float
    clipped: float
    note: str = ""
    baseline_pa: float = nan
    baseline_sd_pa: float = nan
    pulse_pa: float = nan
    pulse_sd_pa: float = nan
    pulse_below_pa: float = nan
    rate_hz: float = nan
    p_value: float = 1.0

    @property
    def x_mm(self) -> float:
        """Where along the row; NaN without positions."""
        return 1e3 * self.x_m

    @property
    def y_mm(self) -> float:
        """Which row; NaN without positions."""
        return 1e3 * self.y_m


@dataclass(frozen=True)
class StepFinding:
    """One step of a press in steps: how deep it was held, the force there and the pulse in it,
    trough to crest; NaN where it could not be judged."""

    station: int
    depth_m: float
    force_n: float
    pulse_n: float
    pulse_sd_n: float

    def as_json(self) -> dict[str, Any]:
        """JSON-able; None where a number is unknown."""
        return {
            "station": self.station,
            "depth_mm": _mm(self.depth_m),
            "force_n": _known(self.force_n),
            "pulse_n": _known(self.pulse_n),
            "pulse_sd_n": _known(self.pulse_sd_n),
        }


@dataclass(frozen=True)
class ObjectFinding:
    """One thing beneath. Positions and the 95 % interval in m, NaN without positions.

    ``peak_pa`` is how much stiffer (negative: softer) it makes the place than its surroundings.
    ``confidence`` is the posterior probability of ``kind``; of an undecided one that of the
    likeliest kind, or that what moves is a pulse. ``course`` has a point (x, y) per row
    of a grid where the object was seen, ``stenosed_m`` the rows (y) between which it is diseased.
    ``diseased`` is the probability of a stenosis if it is known elsewhere that this is a vessel.
    ``p_stiff`` is the probability that a vessel gives way less than a healthy one, by plaque or by
    a calcified wall; NaN of what is likelier none. ``chances`` are the posterior probabilities of
    the kinds, empty where unknown. ``contrast`` is
    ``peak_pa`` over the level of the surroundings and ``pulse_share`` the pulse over the level at
    the object, each (value, standard deviation) and None where unknown.
    ``sizes`` are how deep, how large and how stiff it is, where the scan says so.

    Examples
    --------
    >>> import palpate
    >>> found = palpate.detect("TIHA.run")
    >>> vessel = found.objects[0]
    >>> low_m, high_m = vessel.position_ci_m
    >>> vessel.kind, low_m < 0.032 < high_m
    ('artery', True)
    """

    kind: Kind
    position_m: float
    position_ci_m: tuple[float, float]
    peak_pa: float
    pulse_pa: float
    confidence: float
    reason: str = ""
    course: tuple[tuple[float, float], ...] = ()
    stenosed_m: tuple[float, float] | None = None
    diseased: float = nan
    p_stiff: float = nan
    chances: Mapping[str, float] = field(default_factory=dict)
    contrast: tuple[float, float] | None = None
    pulse_share: tuple[float, float] | None = None
    sizes: Sizes = field(default_factory=Sizes)

    @property
    def is_named(self) -> bool:
        return self.kind != UNDECIDED

    @property
    def is_vessel(self) -> bool:
        return self.kind in VESSELS

    def undecided(self, reason: str) -> "ObjectFinding":
        """The same, its kind open for a ``reason``."""
        return replace(self, kind=UNDECIDED, reason=reason)

    @property
    def position_mm(self) -> float:
        """Where it lies; NaN without positions."""
        return 1e3 * self.position_m

    @property
    def position_ci_mm(self) -> tuple[float, float]:
        """The 95 % interval of `position_mm`."""
        low_m, high_m = self.position_ci_m
        return 1e3 * low_m, 1e3 * high_m


@dataclass(frozen=True)
class Finding:
    """What lies beneath a scan, with ``reason``: why, and what would decide it if undecided.

    ``needed_pa`` is the smallest pulse, trough to crest, that most presses would have shown (NaN:
    unknown), ``asked_pa`` the one that it was to show. ``heart_rate_bpm`` is the rate with its 95 %
    interval, None without a pulse. ``priors`` are what sizes rest on beside the scan.
    ``steps`` are the hold-down curves of presses in steps.

    Examples
    --------
    >>> import palpate
    >>> found = palpate.detect("TIHA.run")
    >>> found.finding, len(found.objects), len(found.stations)
    ('artery', 1, 15)
    """

    finding: Kind
    objects: tuple[ObjectFinding, ...]
    stations: tuple[StationFinding, ...]
    reason: str
    false_alarm: float
    needed_pa: float = nan
    asked_pa: float = nan
    heart_rate_bpm: tuple[float, float, float] | None = None
    priors: Priors = DEFAULT
    steps: tuple[StepFinding, ...] = ()

    def __repr__(self) -> str:
        """As the terminal shows it; the numbers are in the attributes and in `as_json`."""
        return "\n".join(summary(self.as_json()))

    def _repr_html_(self) -> str:
        """The finding, and level and pulse along x or over a grid, for notebooks."""
        first, *more = summary(self.as_json())
        maps = {
            "level": [s.baseline_pa for s in self.stations],
            "pulse": [nan if isfinite(s.pulse_below_pa) else s.pulse_pa for s in self.stations],
        }
        x_mm, y_mm = [s.x_mm for s in self.stations], [s.y_mm for s in self.stations]
        return (
            f"<b>{html.escape(first)}</b>"
            + "".join(f"<br>{html.escape(line)}" for line in more)
            + html.over_places(x_mm, y_mm, maps, "Pa")
        )

    def _pulse_pa(self, thing: ObjectFinding) -> float:
        """An object's pulse; NaN where the station at its place says that it saw none."""
        away = {abs(s.x_m - thing.position_m): s for s in self.stations if isfinite(s.x_m)}
        nearest = away[min(away)] if away and isfinite(thing.position_m) else None
        unseen = nearest is not None and isfinite(nearest.pulse_below_pa)
        return nan if unseen and thing.kind == LUMP else thing.pulse_pa

    def as_json(self) -> dict[str, Any]:
        """JSON-able; None where a number is unknown."""
        return {
            "finding": self.finding,
            "reason": self.reason,
            "needed_pa": _known(self.needed_pa),
            "asked_pa": _known(self.asked_pa),
            "heart_rate_bpm": self.heart_rate_bpm[0] if self.heart_rate_bpm else None,
            "heart_rate_ci_bpm": list(self.heart_rate_bpm[1:]) if self.heart_rate_bpm else None,
            "priors": self.priors.model_dump(mode="json"),
            "objects": [_object(one, self._pulse_pa(one)) for one in self.objects],
            "stations": [
                {
                    "station": s.station,
                    "x_mm": _mm(s.x_m),
                    "y_mm": _mm(s.y_m),
                    "baseline_pa": _known(s.baseline_pa),
                    "baseline_sd_pa": _known(s.baseline_sd_pa),
                    "pulse_pa": _known(s.pulse_pa),
                    "pulse_sd_pa": _known(s.pulse_sd_pa),
                    "pulse_below_pa": _known(s.pulse_below_pa),
                    "clipped": s.clipped,
                    "note": s.note,
                }
                for s in self.stations
            ],
        } | ({"steps": [step.as_json() for step in self.steps]} if self.steps else {})


@dataclass(frozen=True)
class ObjectPair:
    """What lies at one place in scan A and in scan B; None where one of them shows nothing there.

    ``change`` is, by the name of a quantity, (B over A less 1, low, high): its 95 % interval.
    """

    a: ObjectFinding | None
    b: ObjectFinding | None
    change: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """JSON-able; each field is a pair, A first, None where that scan shows nothing."""
        both = (self.a, self.b)
        return {
            "kind": [one and one.kind for one in both],
            "position_mm": [one and _mm(one.position_m) for one in both],
            "change": {name: value for name, (value, _, _) in self.change.items()},
            "change_ci": {name: [low, high] for name, (_, low, high) in self.change.items()},
        }


@dataclass(frozen=True)
class Comparison:
    """Which of two scans shows a diseased artery, and what changed; ratios are A over B.

    Examples
    --------
    >>> import palpate
    >>> recording = palpate.open_run("TIHA.run").recording()
    >>> compared = palpate.compare(recording, recording)
    >>> compared.diseased, compared.peak_ratio
    ('neither', 1.0)
    """

    diseased: Diseased
    peak_ratio: float
    pulse_ratio: float
    confidence: float
    reason: str
    objects: tuple[ObjectPair, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """JSON-able; None where a number is unknown."""
        return {
            "diseased": self.diseased,
            "peak_ratio": _known(self.peak_ratio),
            "pulse_ratio": _known(self.pulse_ratio),
            "confidence": _known(self.confidence),
            "reason": self.reason,
            "objects": [pair.as_json() for pair in self.objects],
        }


def without_stress(recording: Recording, false_alarm: float) -> Finding:
    """Of readings that nothing turns into pascals."""
    reason = (
        f"the sensor reads {recording.unit}, which nothing turns into pascals: no level, pulse or "
        "kind is stated; --empty says which presses are unlike presses over nothing"
    )
    stations = tuple(
        StationFinding(
            s.index + 1, s.x_m, s.y_m, float(s.saturated.mean()) if s.saturated.size else 0.0
        )
        for s in recording.stations
    )
    return Finding(UNDECIDED, (), stations, reason, false_alarm)


def _object(one: ObjectFinding, pulse_pa: float) -> dict[str, Any]:
    low, high = (_mm(edge) for edge in one.position_ci_m)
    fields: dict[str, Any] = {
        "kind": one.kind,
        "position_mm": _mm(one.position_m),
        "position_ci_mm": None if low is None or high is None else [low, high],
        "peak_pa": _known(one.peak_pa),
        "pulse_pa": _known(pulse_pa),
        "confidence": _known(one.confidence),
    }
    fields["p_stiff"] = _known(one.p_stiff)
    fields |= one.sizes.as_json()
    if one.course:
        fields["course_mm"] = [[_mm(x), _mm(y)] for x, y in one.course]
    if one.stenosed_m is not None:
        fields["stenosed_mm"] = [_mm(edge) for edge in one.stenosed_m]
    return fields


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _mm(value_m: float) -> float | None:
    return round(1e3 * float(value_m), DECIMALS) if isfinite(value_m) else None
