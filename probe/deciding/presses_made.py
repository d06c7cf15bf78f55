"""What a planner that stands on detection keeps: its presses, its limits, and when holds end."""

from dataclasses import replace

from probe.core.recording import Recording
from probe.deciding.limits import Limits
from probe.detection.pulse.estimate import SHORTEST_TRAIN_S
from probe.detection.pulse.least_pulse import chance_each, least_pulse_pa
from probe.detection.pulse.presses import presses_of
from probe.planning.plan import Place, Plan

PULSE_N = 2.55e-3
"""Pulse of the paper's stenotic artery, between 80 and 120 mmHg (`palpate press TISA --x 32 --depth
2.5 --pressure 80 --pressure 120`): the smallest of its scenes."""
KNOWN = 0.2
"""Half the 95 % interval of a pulse that is known, over the pulse. With half and with twice of it
12 scans (TIHA at 5 mN, TISA at 0.5 and 5 mN) are all named alike; contact is 62, 55 and 53 s."""


class PressesMade:
    """Base of planners over the stations of ``plan``: hears of every press, and ends its hold.

    ``false_alarm`` is the chance that any press of the plan shows a pulse where there is none; all
    looks at all holds share it.
    """

    def __init__(self, plan: Plan, false_alarm: float, limits: Limits) -> None:
        self._plan, self._limits = plan, limits
        self._holds_s = _ends_s(plan.hold_s)
        each = chance_each(false_alarm, len(plan.places))
        self._each = each / max(len(self._holds_s) - 1, 1)
        self._readings: dict[int, Recording] = {}

    def tell(self, reading: Recording) -> None:
        """Keep the press."""
        (station,) = reading.stations
        self._readings[station.index] = reading

    def enough(self, reading: Recording) -> bool:
        """The pulse is known, or one that matters would have shown."""
        return _pulse_known(reading, self._each)

    def _missing(self) -> list[Place]:
        """Stations that are not pressed yet."""
        return [place for place in self._plan.places if place.index not in self._readings]

    def _spent(self) -> str | None:
        """Which limit the next press would exceed."""
        return self._limits.reached(self._plan, list(self._readings.values()))

    def _so_far(self) -> Recording:
        """All presses, as of a scan that ends here."""
        readings = [self._readings[n] for n in sorted(self._readings)]
        stations = tuple(station for reading in readings for station in reading.stations)
        return replace(readings[0], stations=stations, finish="completed")

    @property
    def _count(self) -> str:
        return f"after {len(self._readings)} of {len(self._plan.places)} stations"


def _pulse_known(reading: Recording, each: float) -> bool:
    """Whether the pulse of a ``reading`` of one press is known, or would have shown, where ``each``
    press has that chance of a false one."""
    (press,) = presses_of(reading, each)
    pulse = press.pulse
    if pulse is None or (press.cause is not None and not press.pulsing):
        return False
    if press.pulsing:
        return 1.96 * pulse.size_sd_pa <= KNOWN * pulse.size_pa
    if pulse.search is None:
        return False
    return least_pulse_pa(pulse.search, each) <= PULSE_N / reading.face_m2


def _ends_s(longest_s: float) -> tuple[float, ...]:
    """Halves, quarters ... of the longest hold in which a train of beats is known from what else
    moves, ascending."""
    holds_s = [longest_s]
    while holds_s[0] / 2 > SHORTEST_TRAIN_S:
        holds_s.insert(0, holds_s[0] / 2)
    return tuple(holds_s)
