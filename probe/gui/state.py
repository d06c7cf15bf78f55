"""What a window shows, as plain data: events in, numbers out, no Qt.

`ViewState.update` takes one event at a time, from a running scan or a replay alike.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from drivers import Block, Channel
from drivers.core.arrays import Array
from probe.core.contact_stress import (
    StressConversion,
    face_m2_of,
    simulated_channels,
    stress_conversion,
)
from probe.core.errors import RunFileError
from probe.core.events import (
    Event,
    Finish,
    Note,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.core.places import plans_rows
from probe.gui.averaged_beat import averaged_beat
from probe.gui.press_trace import HeldTaxels, PressTrace

TRACE_S = 12.0
MIN_HOLD_SAMPLES = 8
STALE_S = 1.0


@dataclass(frozen=True)
class Place:
    """A station of the plan, in mm; ``surface_mm`` is the planned surface's height there."""

    index: int
    x_mm: float
    y_mm: float
    surface_mm: float


class Measured(NamedTuple):
    """A station's level and pulse [Pa]. A pulse that is not known or was not seen is NaN;
    ``below_pa`` is then what detection says that it is below, NaN where it says nothing."""

    level_pa: float
    pulse_pa: float
    below_pa: float = float("nan")


@dataclass
class Trace:
    """The last `TRACE_S` seconds of one device: ``time_s`` (n,) and ``values`` (n, channels)."""

    channels: tuple[Channel, ...]
    blocks: deque[Block] = field(default_factory=deque)
    lost: int = 0

    def add(self, block: Block) -> None:
        self.lost += block.lost
        if not len(block.time_s):
            return
        self.blocks.append(block)
        while self.blocks[0].time_s[-1] < block.time_s[-1] - TRACE_S:
            self.blocks.popleft()

    def arrays(self) -> tuple[Array, Array]:
        if not self.blocks:
            return np.empty(0), np.empty((0, len(self.channels)))
        return (
            np.concatenate([b.time_s for b in self.blocks]),
            np.concatenate([b.values for b in self.blocks]),
        )


@dataclass
class ViewState:
    """A run as seen so far. ``now_s`` is the scan clock's latest time; NaN before the start.

    ``maps`` hold what is measured at each station: by ``finding``, the latest JSON of detection,
    where the station is complete; before that the hold's mean and the height of its mean beat.
    ``presses`` hold each station's signal, ``images`` what each channel read in its hold (k,) [Pa],
    and ``held`` the channels in the latest hold. ``faults`` are those since the run was last
    started or resumed. ``seen`` counts what came in: what has not changed need not be drawn again.
    ``late_s`` is how long ago this was the latest. ``trouble`` is why nothing later can be read,
    ``unjudged`` why there is no newer finding.
    """

    config: Mapping[str, Any] = field(default_factory=dict)
    started_utc: str = ""
    plan: tuple[Place, ...] = ()
    is_grid: bool = False
    traces: dict[str, Trace] = field(default_factory=dict)
    phase: Phase = Phase.IDLE
    phases: deque[tuple[float, Phase]] = field(default_factory=lambda: deque(maxlen=200))
    station: int | None = None
    maps: dict[int, Measured] = field(default_factory=dict)
    presses: dict[int, PressTrace] = field(default_factory=dict)
    finding: Mapping[str, Any] | None = None
    trouble: str = ""
    unjudged: str = ""
    pressed: list[int] = field(default_factory=list)  # stations of the maps, in order, repeats too
    complete: set[int] = field(default_factory=set)
    images: dict[int, Array] = field(default_factory=dict)
    held: HeldTaxels = field(default_factory=HeldTaxels)
    notes: list[Note] = field(default_factory=list)
    faults: list[Note] = field(default_factory=list)
    finish: Finish | None = None
    reason: str = ""
    now_s: float = float("nan")
    seen: int = 0
    late_s: float = 0.0
    _places: dict[int, Place] = field(default_factory=dict)
    _conversions: dict[str, StressConversion] = field(default_factory=dict)
    _measured: dict[int, Measured] = field(default_factory=dict)
    _began_s: float = float("nan")
    _spent_s: float = 0.0
    _timed: int = 0

    def update(self, event: Event) -> None:
        """Take in the next event."""
        self.seen += 1
        match event:
            case RunStarted():
                self._start(event)
            case StationStarted(time_s, station):
                self.station, self._began_s = station, time_s
                self.presses[station] = PressTrace()
                self.held = HeldTaxels()
                self._tick(time_s)
            case PhaseEntered(time_s, phase, _):
                if self.station is not None and phase is Phase.HOLDING:
                    self.presses[self.station].hold_from_s = time_s
                elif self.station is not None and self.phase is Phase.HOLDING:
                    self.presses[self.station].hold_to_s = time_s
                self.phase = phase
                self.phases.append((time_s, phase))
                self._tick(time_s)
            case Samples():
                self._samples(event)
            case StationEnded(time_s, station, _, complete):
                if complete:
                    self.complete.add(station)
                    self._take_measured([station])
                    self._spent_s += time_s - self._began_s
                    self._timed += 1
                self._tick(time_s)
            case Note():
                self.notes.append(event)
                if event.level == "fault":
                    self.faults.append(event)
                self._tick(event.time_s)
            case RunEnded(time_s, finish, reason):
                self.finish, self.reason, self.phase = finish, reason, Phase.FINISHED
                self._tick(time_s)

    def judge(self, finding: Mapping[str, Any]) -> None:
        """Take in what detection measured: the heart's rate, and each station it judged."""
        self.seen += 1
        self.finding, self.unjudged = finding, ""
        self._measured = {
            each["station"] - 1: Measured(
                each["baseline_pa"],
                each["pulse_pa"] if each["pulse_below_pa"] is None else float("nan"),
                _known(each["pulse_below_pa"]),
            )
            for each in finding["stations"]
            if None not in (each["baseline_pa"], each["pulse_pa"])
        }
        self._take_measured(self.complete)

    def _take_measured(self, stations: Iterable[int]) -> None:
        known = {n: self._measured[n] for n in stations if n in self._measured}
        self.pressed += [n for n in known if n not in self.maps]
        self.maps |= known

    def _tick(self, time_s: float) -> None:
        self.now_s = time_s if np.isnan(self.now_s) else max(self.now_s, time_s)

    def _start(self, event: RunStarted) -> None:
        """A resumed run starts again: what was complete stays."""
        self.config, self.started_utc = event.config, event.started_utc
        plan = event.config.get("plan", {})
        places = plan.get("stations", ())
        heights_mm = plan.get("surface_mm") or [0.0] * len(places)  # an import knows none
        self.plan = tuple(
            Place(int(i), _known(x), _known(y), float(z))
            for (i, x, y), z in zip(places, heights_mm, strict=True)
        )
        self._places = {one.index: one for one in self.plan}
        self.is_grid = plans_rows(event.config)
        self.traces = {name: Trace(tuple(each)) for name, each in event.channels.items()}
        self.finish, self.reason, self.faults = None, "", []
        self.now_s = event.time_s
        self._conversions = {}
        for name, channels in event.channels.items():
            try:
                found = stress_conversion(channels, face_m2_of(event.config))
            except RunFileError as error:  # shown without a map
                self.notes.append(Note(event.time_s, "warning", name, str(error)))
                continue
            if found.columns:
                self._conversions[name] = found

    def _samples(self, event: Samples) -> None:
        trace = self.traces.setdefault(event.device, Trace(()))
        trace.add(event.block)
        if not len(event.block.time_s):
            return
        self._tick(float(event.block.time_s[-1]))
        if event.device != self.signal_device or event.station is None:
            return
        pressed = self.stress_pa(event.device, event.block.values)
        press = self.presses.setdefault(event.station, PressTrace())
        press.add(event.block.time_s, pressed.mean(axis=1))
        # A block may reach over either end of the hold, and come after the phase has changed.
        held = press.held(event.block.time_s)
        if held.any():
            self.held.add(event.block.time_s[held], pressed[held])
            self.images[event.station] = self.held.mean_pa
            self._map(event.station)

    def _map(self, station: int) -> None:
        time_s, stress_pa = self.hold()
        if len(time_s) >= MIN_HOLD_SAMPLES:
            pulse_pa = float("nan")
            if (period_s := self.period_s) is not None:
                _, beat = averaged_beat(time_s, stress_pa, period_s)
                pulse_pa = float(np.ptp(beat[np.isfinite(beat)]))
            self.maps[station] = Measured(float(stress_pa.mean()), pulse_pa)
            if not self.pressed or self.pressed[-1] != station:
                self.pressed.append(station)

    def hold(self) -> tuple[Array, Array]:
        """Times (n,) and mean stress (n,) [Pa] of the current hold."""
        press = self.presses.get(-1 if self.station is None else self.station, PressTrace())
        return press.hold(marked=bool(self.phases))  # an import may know no phases

    @property
    def signal_device(self) -> str:
        """The first device whose values are a contact stress; empty if there is none."""
        return next(iter(self._conversions), "")

    def stress_pa(self, device: str, values: Array) -> Array:
        """The tactile channels (n, k) of ``values`` (n, channels) as contact stress [Pa]."""
        return self._conversions[device].stress_pa(values)

    @property
    def period_s(self) -> float | None:
        """One heartbeat [s]: by detection, or before that a simulated one's; None if neither."""
        if self.finding is not None and (found := self.finding["heart_rate_bpm"]):
            return 60.0 / float(found)
        pulse = (self.config.get("scene") or {}).get("pulse")
        trace = self.traces.get(self.signal_device)
        if not pulse or trace is None or not all(c.simulated for c in trace.channels):
            return None
        return 60.0 / float(pulse["rate_bpm"])

    @property
    def simulated(self) -> tuple[str, ...]:
        """Names of the simulated channels, ``device.channel``."""
        return simulated_channels({name: trace.channels for name, trace in self.traces.items()})

    def place(self) -> Place | None:
        """Where the plan has the station that is pressed; None before the first."""
        return None if self.station is None else self._places.get(self.station)

    def taxel_names(self) -> tuple[str, ...]:
        """The channels of `images`, in their order."""
        found = self._conversions.get(self.signal_device)
        channels = self.traces[self.signal_device].channels if found else ()
        return tuple(channels[n].name for n in found.columns) if found else ()

    def tip_m(self) -> tuple[float, float, float] | None:
        """Where the probe is (x, y, z) [m], or None before the stage was read."""
        stage = self.traces.get("stage")
        if stage is None or not stage.blocks:
            return None
        x, y, z = stage.blocks[-1].values[-1, :3]
        return float(x), float(y), float(z)

    def time_left_s(self) -> float | None:
        """From the mean of the stations so far; None before the first is complete."""
        if self.finish is not None:
            return 0.0
        if not self._timed:
            return None
        running = 0.0 if self.station in self.complete else self.now_s - self._began_s
        mean = self._spent_s / self._timed
        return max(0.0, mean * (len(self.plan) - len(self.complete)) - max(0.0, running))

    def device_states(self) -> dict[str, str]:
        """``ok``, ``silent N s``, ``lost``, ``waiting`` or ``closed``, for each device."""
        faulted = {note.device for note in self.faults}
        states = {}
        for name, trace in self.traces.items():
            age = self.now_s - trace.blocks[-1].time_s[-1] if trace.blocks else float("inf")
            if name in faulted:
                states[name] = "lost"
            elif self.finish is not None:
                states[name] = "closed"
            elif not trace.blocks:
                states[name] = "waiting"
            else:
                states[name] = f"silent {age:.0f} s" if age > STALE_S else "ok"
        return states


def _known(length_mm: float | None) -> float:
    """An imported recording may know no positions."""
    return float("nan") if length_mm is None else float(length_mm)
