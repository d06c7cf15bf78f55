"""A running scan as Lab Streaming Layer streams, for recorders and stimulus programs beside it.

``palpate DEVICE`` carries every sample of a device (the stage's x, y, z included), and
``palpate phase`` a marker whenever the probe enters a phase or a station begins or ends.
"""

import math

from drivers.core.extras import needs
from probe.core.events import Event, PhaseEntered, RunStarted, Samples, StationEnded, StationStarted

with needs("lsl", "--lsl"):
    import pylsl


class LslPublisher:
    """An observer of a scan; stamps are on LSL's local clock.

    An event arrives after it happened, so the least difference between the clocks seen so far is
    the nearest to the true one (the minimum-delay filter of network time protocols).
    """

    def __init__(self) -> None:
        self._outlets: dict[str, pylsl.StreamOutlet] = {}
        self._phase: pylsl.StreamOutlet | None = None
        self._shift_s = math.inf

    def __call__(self, event: Event) -> None:
        """Publish one event."""
        match event:
            case RunStarted():
                self._begin(event)
            case Samples() if len(event.block.time_s) and event.device in self._outlets:
                stamps = (event.block.time_s + self._shift_s).tolist()
                self._outlets[event.device].push_chunk(event.block.values.tolist(), stamps)
            case PhaseEntered():
                self._mark(event.phase.value, event.time_s)
            case StationStarted():
                self._mark(f"station {event.station + 1} begins", event.time_s)
            case StationEnded():
                self._mark(f"station {event.station + 1} ends", event.time_s)

    def _begin(self, started: RunStarted) -> None:
        self._shift_s = math.inf  # a resumed run may have another clock
        self._follow(started.time_s)
        for device, channels in started.channels.items():
            info = pylsl.StreamInfo(
                f"palpate {device}", "palpate", len(channels), pylsl.IRREGULAR_RATE,
                pylsl.cf_double64, f"palpate {device}",
            )  # fmt: skip
            described = info.desc().append_child("channels")
            for channel in channels:
                child = described.append_child("channel")
                child.append_child_value("label", channel.name)
                child.append_child_value("unit", channel.unit)
            self._outlets[device] = pylsl.StreamOutlet(info)
        info = pylsl.StreamInfo(
            "palpate phase", "Markers", 1, pylsl.IRREGULAR_RATE, pylsl.cf_string, "palpate phase"
        )
        self._phase = pylsl.StreamOutlet(info)

    def _follow(self, time_s: float) -> None:
        self._shift_s = min(self._shift_s, pylsl.local_clock() - time_s)

    def _mark(self, text: str, time_s: float) -> None:
        self._follow(time_s)
        if self._phase is not None:
            self._phase.push_sample([text], time_s + self._shift_s)
