"""In which modes a UR does not work (protective and emergency stops, no program), in words.

Numbers by Universal Robots, "RTDE guide": safety mode, robot mode, runtime state.
"""

from drivers.ur.client import PAUSED, PLAYING, State

RUNNING = 7
STOPPED = "its control program has stopped: somebody has ended it, or its log says why"
PAUSES = "its control program is paused on the pendant"
UNHEARD = "its control program has stopped: it had heard nothing from here for watchdog_s"
HALTED = "its control program has stopped: it did not answer, and was ended from here"
LOCAL = "its control program has stopped: the pendant was switched to local control"
PROGRAM_RUNS = (2, 3, 4, 5, 6)  # playing, pausing, paused, resuming, retracting
SAFETY_STOPS = {
    3: "protective stop: clear it on the pendant, and find out why",
    4: "recovery mode: move the arm out of its safety limits on the pendant",
    5: "safeguard stop: close the safeguard",
    6: "emergency stop of the cell",
    7: "emergency stop: release the button and restart the robot",
    8: "safety violation",
    9: "safety fault: restart the controller",
    10: "safety: the joints' identity is being checked",
}
MODES = {
    -1: "no controller", 0: "disconnected", 1: "confirming safety", 2: "booting", 3: "power off",
    4: "power on, not started", 5: "idle: release the brakes", 6: "back-drive", 8: "updating",
}  # fmt: skip


def why_stopped(state: State, *, controls: bool) -> str | None:
    """None if the robot works; with ``controls`` its control program must run."""
    if (words := SAFETY_STOPS.get(state.safety_mode)) is not None:
        return words
    # A playing program implies a running robot; the mode only says why none plays.
    if state.runtime_state != PLAYING and state.robot_mode != RUNNING:
        return f"the robot is not running ({MODES.get(state.robot_mode, str(state.robot_mode))})"
    if not controls or state.runtime_state == PLAYING:
        return None
    if state.teaches:
        return "its freedrive (teach) button is pressed: its control program does not run"
    return PAUSES if state.runtime_state in PAUSED else STOPPED
