"""Cuts a run's events into stations: each press's tactile signal, phases and depth."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers import Block
from drivers.core.arrays import Array, Bools, columns_of
from probe.core.contact_stress import (
    face_m2_of,
    simulated_channels,
    stress_conversion,
    tactile_device,
)
from probe.core.errors import RunFileError
from probe.core.events import (
    Event,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.core.places import planned
from probe.core.recording import Recording, Station
from probe.core.spill import Growing, Spill

OF_BLOCK = ("plane", "tissue", "indenter", "support")
"""What a rig knows of a scene: not what lies in it."""
MAX_LEVELS, MAX_PARTS = 20_000, 16
PART = 1 << 16  # samples of a press that are computed at once: half a megabyte a column


def record(
    events: Iterable[Event], face_mm2: float | None = None, *, any_unit: bool = False
) -> Recording:
    """The recording of a run; ``face_mm2`` is the probe's face where the run does not say.

    A run that has not ended (killed, or still going) counts as ``faulted``.
    Raises `RunFileError` if the events do not make a run, a force has no known face, or the signal
    is neither force nor pressure; with ``any_unit`` such a signal stays in its own unit.
    """
    signal: _Signal | None = None
    finish, ended = "faulted", ""
    presses: dict[tuple[int, int], _Press] = {}
    complete: dict[int, Station] = {}
    for event in events:
        match event:
            case RunStarted():
                signal = signal or _Signal(event, face_mm2, any_unit)
                finish, ended = "faulted", ""
            case RunEnded():
                finish, ended = str(event.finish), event.reason
            case StationStarted(_, station, attempt, x_m, y_m) if signal is not None:
                presses = {(station, attempt): signal.press(x_m, y_m)}
            case PhaseEntered(time_s, phase, station) if station is not None:
                for (at, _), press in presses.items():
                    if at == station:
                        press.phases[phase] = time_s
            case Samples(device, block, station, attempt) if station is not None:
                if (found := presses.get((station, attempt or 0))) is not None:
                    for one in found.measured:
                        one.add(device, block)
            case StationEnded(_, station, attempt, True) if signal is not None:
                whole = presses.pop((station, attempt), None)
                complete[station] = signal.station(
                    station, whole or signal.press(math.nan, math.nan)
                )
    if signal is None:
        raise RunFileError("the run has no beginning")
    try:
        return Recording(
            tuple(complete[n] for n in sorted(complete)),
            signal.names,
            simulated_channels(signal.channels),
            signal.face_m2,
            finish,
            signal.quantum_pa or 0.0,
            ended,
            signal.block,
            signal.unit,
            signal.step_hold_s,
        )
    except ValueError as error:
        raise RunFileError(str(error)) from None


class _Measured:
    """What columns of one device measured in one press, times ``gains``. A device that lacks a
    column is refused when they are asked for."""

    def __init__(self, device: str, columns: list[int], gains: Array | float = 1.0) -> None:
        self._device, self._last, self._gains = device, max(columns), gains
        self._columns = columns_of(columns)
        self._lacks = False
        self._time_s = Growing(np.float64)
        self._values = Growing(np.float64, len(columns))
        self._saturated = Growing(np.bool_, len(columns))

    def add(self, device: str, block: Block) -> None:
        """Append a block, if it is this device's."""
        if device != self._device or not len(block.time_s):
            return
        if block.values.shape[1] <= self._last:
            self._lacks = True
            return
        self._time_s.add(block.time_s)
        self._values.add(block.values[:, self._columns] * self._gains)
        self._saturated.add(block.saturated[:, self._columns])

    def whole(self) -> tuple[Array, Array, Bools]:
        """Times (n,), values (n, columns) and saturation (n, columns)."""
        if self._lacks:
            raise RunFileError("a block of samples has fewer channels than its device")
        return self._time_s.whole(), self._values.whole(), self._saturated.whole()

    def parts(self, count: int) -> Iterator[slice]:
        """The rows up to ``count``, as many at once as memory is for."""
        for first in range(0, count, PART):
            yield slice(first, min(first + PART, count))
            self.rest()

    def rest(self) -> None:
        """Take out of memory what is in files too."""
        for one in (self._time_s, self._values, self._saturated):
            one.rest()


@dataclass
class _Press:
    """What was recorded of one attempt, and when each phase began.

    ``measured``: the tactile signal [Pa], the stage's height or the depth as recorded elsewhere
    [m], the signal's first column as it was read (for the step of the readings, of the first
    press) and the reference, where there are.
    """

    x_m: float
    y_m: float
    signal: _Measured
    height: _Measured
    raw: _Measured | None
    reference: _Measured | None
    phases: dict[Phase, float] = field(default_factory=dict)

    @property
    def measured(self) -> Iterator[_Measured]:
        """All of them."""
        found = (self.signal, self.height, self.raw, self.reference)
        return (one for one in found if one is not None)


class _Signal:
    """Which channels make the tactile signal, and in which unit."""

    def __init__(self, started: RunStarted, face_mm2: float | None, any_unit: bool) -> None:
        self._spill = Spill()
        self.channels = started.channels
        self.device = tactile_device(self.channels)
        own = self.channels[self.device]
        config = started.config
        self.face_m2 = face_m2_of(config, face_mm2)
        conversion = stress_conversion(own, self.face_m2, any_unit=any_unit)
        self.unit = conversion.unit
        self.picked, self.gains = list(conversion.columns), conversion.pa_per_unit
        self.names = tuple(f"{self.device}.{own[n].name}" for n in self.picked)
        self.reference, self.depth = self._first("reference"), self._first("depth")
        self.surface_m = _surface(config)
        scene = config.get("block") or config.get("scene") or {}  # of an import only the block
        self.block = {key: scene[key] for key in OF_BLOCK if key in scene} or None
        self.incline = _incline(config)
        self.step_hold_s = float((config.get("plan") or {}).get("step_hold_s") or 0.0)
        self.compliance_m_per_n = compliance_m_per_n(config)
        self.quantum_pa: float | None = None

    def _first(self, role: str) -> tuple[str, int] | None:
        """Device and column of the first channel with a role."""
        with_role = (
            (device, n)
            for device, own in self.channels.items()
            for n, channel in enumerate(own)
            if channel.role == role
        )
        return next(with_role, None)

    def press(self, x_m: float, y_m: float) -> _Press:
        """An attempt without samples yet."""
        height, column = self.depth or ("stage", 2)
        return _Press(
            x_m,
            y_m,
            _Measured(self.device, self.picked, self.gains),
            _Measured(height, [column]),
            _Measured(self.device, self.picked[:1]) if self.quantum_pa is None else None,
            self.reference and _Measured(self.reference[0], [self.reference[1]]),
        )

    def station(self, index: int, press: _Press) -> Station:
        """What detection works on, of a press that is complete."""
        time_s, signal_pa, saturated = press.signal.whole()
        # readings before the tare have another zero
        tared = slice(
            int(np.searchsorted(time_s, press.phases.get(Phase.APPROACHING, -math.inf), "right")),
            None,
        )
        time_s, signal_pa, saturated = time_s[tared], signal_pa[tared], saturated[tared]
        if press.raw is not None and len(time_s):
            first = press.raw.whole()[1][tared, 0]
            steps = quantum(first[part] for part in press.raw.parts(len(first)))
            self.quantum_pa = steps * float(self.gains[0])
        reference_s, reference, _ = (
            press.reference.whole() if press.reference else (np.empty(0), np.empty((0, 1)), None)
        )
        phase, keep = press.phases, self._spill.keep
        return Station(
            index=index,
            x_m=press.x_m,
            y_m=press.y_m,
            time_s=keep(time_s),
            signal_pa=keep(signal_pa),
            saturated=keep(saturated),
            indent_s=phase.get(Phase.INDENTING, math.nan),
            hold_s=phase.get(Phase.HOLDING, math.nan),
            retract_s=phase.get(Phase.RETRACTING, math.nan),
            depth_m=keep(self._depth(index, press, time_s, signal_pa)),
            reference_s=keep(reference_s),
            reference=keep(reference[:, 0]),
        )

    def _depth(self, index: int, press: _Press, time_s: Array, signal_pa: Array) -> Array:
        """As recorded; or along the normal from the surface, the plan's or where a touch found it
        (where the ramp began), less what the rig has given way."""
        poses_s, poses, _ = press.height.whole()
        if not len(poses_s):
            return np.full(len(time_s), math.nan)
        surface = self.surface_m.get(index, math.nan)
        if math.isnan(surface) and Phase.INDENTING in press.phases:
            surface = float(_between(np.array([press.phases[Phase.INDENTING]]), poses_s, poses)[0])
        found = Growing(np.float64)
        for part in press.signal.parts(len(time_s)):
            depth = _between(time_s[part], poses_s, poses)
            if self.depth is None:
                depth = (surface - depth) / math.cos(self.incline.get(index, 0.0))
                if self.compliance_m_per_n and math.isfinite(self.face_m2):
                    mean_pa = signal_pa[part].mean(axis=1)
                    depth = depth - self.compliance_m_per_n * self.face_m2 * mean_pa
            found.add(depth)
            press.height.rest()
        return found.whole()


def _between(time_s: Array, poses_s: Array, height_m: Array) -> Array:
    """Heights (n,) at ``time_s`` (n,), of ``height_m`` (m, 1) at ascending ``poses_s`` (m,).

    numpy.interp reads all of its points, be they in a file.
    """
    first, last = np.searchsorted(poses_s, [time_s.min(), time_s.max()])
    near = slice(max(int(first) - 1, 0), int(last) + 1)
    return np.asarray(np.interp(time_s, poses_s[near], height_m[near, 0]))


def quantum(parts: Iterable[Array]) -> float:
    """The step that all differences between values are multiples of; 0 if there is none.

    ``parts``, (n,) each, are all of the values. Rounding noise of the subtraction of a tare (1e-6
    of a step) is allowed.
    """
    levels = np.empty(0)
    for part in parts:
        levels = np.unique(np.concatenate([levels, part[np.isfinite(part)]]))[:MAX_LEVELS]
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * np.abs(levels).max(initial=0.0)]
    if not len(steps):
        return 0.0
    for share in range(1, MAX_PARTS if len(steps) >= MAX_PARTS else 2):
        step = float(steps.min()) / share  # perhaps no two readings were only one step apart
        multiples = steps / step
        if np.abs(multiples - np.round(multiples)).max() < 1e-3:
            return step
    return 0.0


def compliance_m_per_n(config: Mapping[str, Any]) -> float:
    """How far the rig itself bends: 0 where its compliance was not calibrated."""
    one = config.get("calibration", {}).get("compliance")
    try:
        return 0.0 if one is None else 1 / float(one["content"]["values"]["stiffness_n_m"]["value"])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        raise RunFileError("config.calibration.compliance: no stiffness_n_m in it") from None


def _incline(config: Mapping[str, Any]) -> dict[int, float]:
    """Angle [rad] between the planned surface's normal and z by station; empty if not known."""
    try:
        degrees = config["plan"]["incline_deg"]
        return {n: math.radians(a) for n, a in zip(planned(config), degrees, strict=True)}
    except (KeyError, TypeError, ValueError):
        return {}


def _surface(config: Mapping[str, Any]) -> dict[int, float]:
    """Height [m] of the planned surface by station; empty where it was to be found by touch."""
    try:
        if ((config.get("rig") or {}).get("scan") or {}).get("touch_n") is not None:
            return {}
        heights_mm = config["plan"]["surface_mm"]
        return {n: 1e-3 * float(z) for n, z in zip(planned(config), heights_mm, strict=True)}
    except (KeyError, TypeError, ValueError, AttributeError):
        return {}
