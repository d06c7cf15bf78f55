"""What GRBL's numbers mean, from its interface documentation (1.1; grblHAL keeps them)."""

ALARMS = {
    1: "hard limit switch hit; the position may be lost: home again",
    2: "soft limit: the target is outside the machine's travel",
    3: "reset while moving; the position may be lost: home again",
    4: "probe: the contact was already closed before the move",
    5: "probe: no contact within the move",
    6: "homing: reset during the cycle",
    7: "homing: safety door opened",
    8: "homing: could not leave the limit switch",
    9: "homing: no limit switch found",
    10: "emergency stop",
    11: "homing required after power-up",
    14: "spindle at speed time-out",
    17: "motor fault",
}

ERRORS = {
    1: "a letter was expected",
    2: "bad number",
    3: "unknown $ command",
    5: "homing is not enabled ($22)",
    8: "only possible when idle",
    9: "locked by an alarm or a jog",
    10: "soft limits ($20) need homing ($22)",
    11: "line too long",
    15: "the target is outside the machine's travel",
    16: "malformed jog command",
    20: "unsupported command",
    22: "no feed rate",
    24: "two commands need the same axis words",
    33: "invalid target",
    79: "not allowed while the emergency stop is active",
}


def alarm_in_words(number: int) -> str:
    """What ``ALARM:n`` says."""
    return f"alarm {number}: {ALARMS.get(number, 'see the controller manual')}"


def error_in_words(number: int) -> str:
    """What ``error:n`` says."""
    return f"error {number}: {ERRORS.get(number, 'see the controller manual')}"


STATES = {
    "Hold": "a feed hold is active: somebody has pressed hold; release it, or reset the board",
    "Run": "the board runs another program; wait for its end, or reset the board",
    "Door": "the safety door is open",
    "Check": "check mode: moves are not carried out; $C ends it",
    "Sleep": "the board sleeps; reset it",
    "Tool": "the board waits for a tool change",
}
"""States in which somebody else is in command."""

DOOR = "D"
PINS = {
    "X": "limit switch of x", "Y": "limit switch of y", "Z": "limit switch of z",
    "A": "limit switch of a", DOOR: "safety door", "R": "reset button", "H": "feed hold button",
    "S": "cycle start button", "E": "emergency stop", "F": "motor fault",
}  # fmt: skip


def pins_in_words(pins: str) -> str:
    """The inputs of a report's ``Pn:`` that keep a scan from beginning; empty if none does.

    A closed probe contact (``P``) does not: it may be what the probe rests on.
    """
    return ", ".join(PINS[pin] for pin in pins if pin in PINS)
