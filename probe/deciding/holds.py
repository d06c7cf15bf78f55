"""When a hold may end: its pulse is known, or one that matters would have shown."""

from probe.core.recording import Recording
from probe.detection.pulse.estimate import SHORTEST_TRAIN_S
from probe.detection.pulse.least_pulse import least_pulse_pa
from probe.detection.pulse.presses import presses_of

PULSE_N = 2.55e-3
"""Pulse of the paper's stenotic artery, between 80 and 120 mmHg (`palpate press TISA --x 32 --depth
2.5 --pressure 80 --pressure 120`): the smallest of its scenes."""
KNOWN = 0.2
"""Half the 95 % interval of a pulse that is known, over the pulse. With half and with twice of it
12 scans (TIHA at 5 mN, TISA at 0.5 and 5 mN) are all named alike; contact is 62, 55 and 53 s."""


def pulse_known(reading: Recording, each: float) -> bool:
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


def ends_s(longest_s: float) -> tuple[float, ...]:
    """Halves, quarters ... of the longest hold in which a train of beats can be told from what else
    moves, ascending."""
    holds_s = [longest_s]
    while holds_s[0] / 2 > SHORTEST_TRAIN_S:
        holds_s.insert(0, holds_s[0] / 2)
    return tuple(holds_s)
