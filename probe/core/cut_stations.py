"""Cuts a run's events into stations: each press's tactile signal, phases and depth."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers import Block
from drivers.core.arrays import Array, Bools
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
from probe.core.spill import Spill

MAX_LEVELS, MAX_PARTS = 20_000, 16


def record(events: Iterable[Event], face_mm2: float | None = None) -> Recording:
    """The recording of a run; ``face_mm2`` is the probe's face where the run does not say.

    A run that has not ended (killed, or still going) counts as ``faulted``.
    Raises `RunFileError` if the events do not make a run, or a force has no known face.
    """
    signal: _Signal | None = None
    finish, ended = "faulted", ""
    presses: dict[tuple[int, int], _Press] = {}
    complete: dict[int, Station] = {}
    quantum_pa: float | None = None
    for event in events:
        match event:
            case RunStarted():
                signal = signal or _Signal(event, face_mm2)
                finish, ended = "faulted", ""
            case RunEnded():
                finish, ended = str(event.finish), event.reason
            case StationStarted(_, station, attempt, x_m, y_m):
                presses = {(station, attempt): _Press(x_m, y_m)}
            case PhaseEntered(time_s, phase, station) if station is not None:
                for (at, _), press in presses.items():
                    if at == station:
                        press.phases[phase] = time_s
            case Samples(device, block, station, attempt) if station is not None:
                if (found := presses.get((station, attempt or 0))) is not None:
                    found.blocks[device].append(block)
            case StationEnded(_, station, attempt, True) if signal is not None:
                whole = presses.pop((station, attempt), _Press(math.nan, math.nan))
                complete[station] = signal.station(station, whole)  # blocks need more memory
                if quantum_pa is None:
                    quantum_pa = signal.quantum_pa(whole)
    if signal is None:
        raise RunFileError("the run has no beginning")
    return Recording(
        tuple(complete[n] for n in sorted(complete)),
        signal.names,
        simulated_channels(signal.channels),
        signal.face_m2,
        finish,
        quantum_pa or 0.0,
        ended,
    )


@dataclass
class _Press:
    """What was recorded of one attempt: blocks by device, and when each phase began."""

    x_m: float
    y_m: float
    blocks: dict[str, list[Block]] = field(default_factory=lambda: defaultdict(list))
    phases: dict[Phase, float] = field(default_factory=dict)


class _Signal:
    """Which channels make the tactile signal, and in which unit."""

    def __init__(self, started: RunStarted, face_mm2: float | None) -> None:
        self._spill = Spill()
        self.channels = started.channels
        self.device = tactile_device(self.channels)
        own = self.channels[self.device]
        config = started.config
        self.face_m2 = face_m2_of(config, face_mm2)
        conversion = stress_conversion(own, self.face_m2)
        self.picked, self.gains = list(conversion.columns), conversion.pa_per_unit
        self.names = tuple(f"{self.device}.{own[n].name}" for n in self.picked)
        self.surface_m = _surface(config)
        self.incline = _incline(config)
        self.compliance_m_per_n = compliance_m_per_n(config)

    def station(self, index: int, press: _Press) -> Station:
        time_s, signal_pa, saturated = self._measured(press, self.picked)
        signal_pa *= self.gains
        reference_s, reference = self._reference(press)
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
            reference=keep(reference),
        )

    def quantum_pa(self, press: _Press) -> float | None:
        """The step of the readings; 0 if they are not multiples of one, None without any."""
        _, values, _ = self._measured(press, self.picked[:1])
        return quantum(values[:, 0]) * float(self.gains[0]) if len(values) else None

    def _measured(self, press: _Press, picked: list[int]) -> tuple[Array, Array, Bools]:
        """What the sensor measured since its tare: readings before it have another zero."""
        time_s, values, saturated = joined(press.blocks[self.device], len(picked), picked)
        tared = np.searchsorted(time_s, press.phases.get(Phase.APPROACHING, -math.inf), "right")
        return time_s[tared:], values[tared:], saturated[tared:]  # no copies: they may be large

    def _depth(self, index: int, press: _Press, time_s: Array, signal_pa: Array) -> Array:
        """Along the normal from the surface: the plan's, or where a touch found it (where the
        ramp began), less what the rig has given way."""
        poses_s, poses, _ = joined(press.blocks["stage"], 3, [0, 1, 2])
        if not len(poses_s):
            return np.full(len(time_s), math.nan)
        z = np.interp(time_s, poses_s, poses[:, 2])
        surface = self.surface_m.get(index, math.nan)
        if math.isnan(surface) and Phase.INDENTING in press.phases:
            surface = float(np.interp(press.phases[Phase.INDENTING], poses_s, poses[:, 2]))
        depth = (surface - z) / math.cos(self.incline.get(index, 0.0))
        if self.compliance_m_per_n and math.isfinite(self.face_m2):
            depth = depth - self.compliance_m_per_n * self.face_m2 * signal_pa.mean(axis=1)
        return depth

    def _reference(self, press: _Press) -> tuple[Array, Array]:
        for device, own in self.channels.items():
            for n, channel in enumerate(own):
                if channel.role == "reference":
                    time_s, values, _ = joined(press.blocks[device], 1, [n])
                    return time_s, values[:, 0]
        return np.empty(0), np.empty(0)


def joined(
    blocks: Sequence[Block], channels: int, picked: Sequence[int]
) -> tuple[Array, Array, Bools]:
    """Times (n,), values (n, channels) and saturation (n, channels) of the ``picked`` columns."""
    if not blocks:
        return np.empty(0), np.empty((0, channels)), np.empty((0, channels), bool)
    if any(block.values.shape[1] <= max(picked) for block in blocks):
        raise RunFileError("a block of samples has fewer channels than its device")
    time_s = np.concatenate([block.time_s for block in blocks])
    values, saturated = (np.empty((len(time_s), len(picked)), kind) for kind in (float, bool))
    end = np.cumsum([len(block.time_s) for block in blocks])
    for block, upto in zip(blocks, end, strict=True):  # one copy: it may be most of the memory
        rows = slice(upto - len(block.time_s), upto)
        values[rows], saturated[rows] = block.values[:, picked], block.saturated[:, picked]
    return time_s, values, saturated


def quantum(values: Array) -> float:
    """The step that all differences between ``values`` (n,) are multiples of; 0 if there is none.

    Rounding noise of the subtraction of a tare (1e-6 of a step) is allowed.
    """
    levels = np.unique(values[np.isfinite(values)])[:MAX_LEVELS]
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * np.abs(levels).max(initial=0.0)]
    if not len(steps):
        return 0.0
    for parts in range(1, MAX_PARTS if len(steps) >= MAX_PARTS else 2):
        step = float(steps.min()) / parts  # perhaps no two readings were only one step apart
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
