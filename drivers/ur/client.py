"""The process that holds the ur-rtde client. It may hang or crash: the scan's process goes on.

ur-rtde hangs with the interpreter locked where a controller accepts and stays silent, blocks for
minutes where one vanishes in a move, and has crashed on dropped connections; so nothing of it
runs where the engine runs.

Reading needs no program on the robot and changes nothing there. Control begins when it is asked
for: the library then uploads its program, in place of whatever runs.

Where the process that guards has died, this one lifts the probe before it ends (`alone`).
"""

import math
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from drivers.ur.alone import ALONE_S, Lift, Replaced, lift_alone
from drivers.ur.dashboard import END_PROGRAM, tell
from drivers.ur.echo import Echo
from drivers.ur.joints import hindrances
from drivers.ur.version import Controller

READY = 0  # number of the answer that says the client is connected
NO_ANSWER = -1  # number of a command that nobody waits for
READ_S = 2e-4  # states that were held up come less than a millisecond apart
OBEY_S = 0.005  # a command wakes at once; the watchdog is kicked within this
SEND_S = 0.004
LEAVE_S = 3.0  # to stop the robot's program, which takes less than one
WATCHDOG_RESETS = 8  # in the time that the robot's watchdog waits: see `settings.WATCHDOG_S`
STARVED_SHARE = 0.5  # of that time without a reset, a state or an answer: four times what is usual
STARTS_S = 5.0  # as long as the library waits for the first start
BEGINS_S = 1.0  # an accepted move is under way within a few cycles, on a busy machine later
NICE_LEVEL = -10
"""Samples and the watchdog wait for nobody's computing."""
PLAYING, PAUSED = 2, (3, 4, 5)  # runtime states; pausing, paused and resuming are one here
TEACH_BIT = 0b100  # of the robot's status bits
REDUCED = 2  # a safety mode in which the arm may move, slower
VARIABLES = [
    "timestamp", "actual_TCP_pose", "actual_TCP_force", "target_TCP_speed", "robot_mode",
    "safety_mode", "runtime_state", "speed_scaling", "target_speed_fraction", "robot_status_bits",
]  # fmt: skip


class State(NamedTuple):
    """One whole sample: the controller's time, and what was true then (SI, base frame).

    ``arrival_s`` is on this machine's monotonic clock. ``target_speed`` is what the controller
    asks of the tool now (m/s and rad/s). ``pace`` is the share of a commanded speed that the
    controller allows. ``busy``: our program says that a move or a stop is under way; it comes by
    another stream than the rest, and may be earlier or later. ``starved``: a moment ago this
    machine or the line, in either direction, stood still for so long that the robot's watchdog may
    have ended our program. ``teaches``: the freedrive button is pressed.
    """

    timestamp_s: float
    arrival_s: float
    pose: tuple[float, ...]
    wrench: tuple[float, ...]
    target_speed: tuple[float, ...]
    safety_mode: int
    robot_mode: int
    runtime_state: int
    pace: float
    busy: bool
    starved: bool = False
    teaches: bool = False


class Control(NamedTuple):
    """What is set before the first move. ``tcp`` and ``payload_kg``: None leaves them.

    ``watchdog_s``: the robot's program stops itself if it hears nothing from us for this long.
    """

    tcp: tuple[float, ...] | None
    payload_kg: float | None
    payload_centre_m: tuple[float, float, float]
    watchdog_s: float


def serve(
    host: str, controller: Controller, frequency_hz: float, states: Connection, commands: Connection
) -> None:
    """Body of the process: stream states, obey commands, until the other end closes or dies."""
    import rtde_receive

    terminal = _silence()
    with suppress(AttributeError, OSError):  # a terminal's Ctrl-C is for the scan, which lifts
        os.setsid()
    with suppress(OSError):  # only root may
        os.setpriority(os.PRIO_PROCESS, 0, NICE_LEVEL)
    try:
        known = [*VARIABLES, "payload"] if controller.reports_payload else VARIABLES
        receive = rtde_receive.RTDEReceiveInterface(host, frequency_hz, known)
    except RuntimeError as error:
        commands.send((READY, False, str(error)))
        return
    client = _Client(host, frequency_hz, receive, controller.reports_payload)
    threading.Thread(target=client.stream, args=(states,), daemon=True).start()
    commands.send((READY, True, ""))
    try:
        client.obey(commands)
    except (EOFError, OSError):  # nobody has said farewell
        with suppress(OSError):
            os.write(terminal, f"palpate: {client.left_alone()}\n".encode())
    finally:
        client.end.set()
        if client.control is not None:
            client.control.stopScript()


def _silence() -> int:
    """The library talks to standard output and error, which belong to the scan; the latter is
    returned, for last words."""
    nowhere, terminal = os.open(os.devnull, os.O_WRONLY), os.dup(2)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    return terminal


class _Client:
    """Both interfaces of the library; a thread streams, the main one obeys."""

    def __init__(self, host: str, frequency_hz: float, receive: Any, has_payload: bool) -> None:
        self.control: Any = None
        self.end = threading.Event()
        self._host = host
        self._frequency_hz = frequency_hz
        self._receive = receive
        self._has_payload = has_payload
        self._echo = Echo(host, self.end)
        self._lift: Lift | None = None
        self._guarded = False
        self._detects = False
        self._before = (-1, 0.0)
        self._kicked_s = 0.0
        self._kick_s = 0.0
        self._watchdog_s = math.inf
        self._starved_s = -math.inf
        self._parent = os.getppid()

    def stream(self, states: Connection) -> None:
        """Send every new sample; a few at a time, so that the pipe is not the bottleneck.

        When nobody listens any more `obey` ends too, and with it the process, once it has lifted
        the probe where need be; unless the library waits for a controller that has gone as well,
        which it does for ever. The library does not
        connect again by itself after a cut: the process ends at once, so that a new one may.
        """
        waiting: list[State] = []
        last_s, sent_s, arrival_s = -1.0, 0.0, time.monotonic()
        while not self.end.is_set() and os.getppid() == self._parent:
            state = whole_state(self._receive, last_s, self._busy)
            if state is not None:
                self._notice_starving(state.arrival_s - arrival_s, self._echo.unanswered_s())
                last_s, arrival_s = state.timestamp_s, state.arrival_s
                starved = state.arrival_s - self._starved_s < self._watchdog_s
                waiting.append(state._replace(starved=starved))
            now_s = time.monotonic()
            if waiting and now_s - sent_s >= SEND_S:
                sent_s = now_s
                try:
                    states.send(waiting)
                except OSError:
                    break
                waiting = []
            if not self._receive.isConnected():
                os._exit(1)
            time.sleep(READ_S)
        self.end.wait(ALONE_S)
        time.sleep(LEAVE_S)
        os._exit(1)

    def obey(self, commands: Connection) -> None:
        """One command at a time."""
        while not self.end.is_set():
            if not self._guarded:  # nobody checks a force: the watchdog guards this process
                self._kick()
            if not commands.poll(OBEY_S):
                continue
            number, name, arguments = commands.recv()
            try:
                answer = (number, *self._do(name, arguments))
            except (RuntimeError, ValueError, IndexError) as error:
                answer = (number, False, str(error))
            if number != NO_ANSWER:
                commands.send(answer)
            if name == "stop":  # whoever stops does not wait for it
                with suppress(RuntimeError):
                    self._end_detection()

    def left_alone(self) -> str:
        """Lift if it is known where to and our program runs; how that went, in words."""
        if self.control is None:
            return "what guards the robot has died; it had not moved it"
        if self._receive.getRuntimeState() in PAUSED:  # nobody would stop an arm that goes on
            tell(self._host, END_PROGRAM)
        how = "it was not said where to lift the probe to"
        if self._lift is not None:
            try:
                how = lift_alone(self.control, self._receive, self._plays_on, self._lift)
            except Replaced:
                self.control = None  # its end would be that of the program that came after it
                how = "its program has ended: look at the probe"
        return f"what guards the robot has died; {how}"

    def _do(self, name: str, arguments: tuple[Any, ...]) -> tuple[bool, Any]:
        control = self.control
        match name:
            case "take control":
                return self._take_control(*arguments)
            case "lift when alone":
                (self._lift,) = arguments
                return True, ""
            case "farewell":
                self.end.set()
                return True, ""
            case "guarded":  # whoever checks the force has just done so
                self._guarded = True
                self._kick()
                return True, ""
            case _ if control is None:
                return False, "nobody has taken control"
            case "move" | "search":
                pose, speed, acceleration = arguments
                self._end_detection()
                self._begin_operation()
                if not control.moveL(list(pose), speed, acceleration, True):
                    return False, ""
                if name == "search":
                    self._detects = True
                    if not control.startContactDetection():
                        self._stop(acceleration)
                        self._end_detection()
                        return False, "the controller does not look for contact"
                return True, ""
            case "touched":
                return True, self._end_detection()
            case "stop":
                self._stop(arguments[0])
                return True, ""
            case "zero":
                return control.zeroFtSensor(), ""
            case "why not":
                return True, hindrances(control, *arguments)
        raise ValueError(name)

    def _stop(self, deceleration_m_s2: float) -> None:
        """While the program looks for contact it waits for the end of a stop: with a contact in a
        stop that goes on beside it, two of its threads would move the arm, which ends it."""
        if not self._detects:
            self._begin_operation()
        self.control.stopL(deceleration_m_s2, not self._detects)  # answers nothing

    def _end_detection(self) -> bool:
        """Whether the controller has found contact.

        Asked twice: an answer may be the end of the way back from it, whatever was asked.
        """
        detected, self._detects = self._detects, False
        control = self.control
        return detected and (control.stopContactDetection() or control.readContactDetection())

    def _take_control(self, setup: Control) -> tuple[bool, Any]:
        """Upload the program, set what is to be set, and return what then holds."""
        import rtde_control

        self._detects, self._before = False, (-1, 0.0)  # nothing that the last one was doing
        if self.control is None:
            control = rtde_control.RTDEControlInterface(self._host, self._frequency_hz)
        else:
            control, self.control = self.control, None
            if not (control.reuploadScript() and self._plays()):
                return False, "its control program does not start"
        steps: list[tuple[str, tuple[Any, ...]]] = []
        if setup.tcp is not None:
            steps.append(("setTcp", (list(setup.tcp),)))
        if setup.payload_kg is not None:
            steps.append(("setPayload", (setup.payload_kg, list(setup.payload_centre_m))))
        steps.append(("getTCPOffset", ()))
        steps.append(
            ("setWatchdog", (1 / setup.watchdog_s,))
        )  # last: from then on it wants to be kicked
        found = {}
        for name, arguments in steps:
            found[name] = getattr(control, name)(*arguments)
            if not found[name]:
                control.stopScript()
                return False, f"the controller has refused {name}"
        control.kickWatchdog()
        self._kicked_s, self._watchdog_s = time.monotonic(), setup.watchdog_s
        tcp = tuple(found["getTCPOffset"])
        self._guarded = False
        self._kick_s = setup.watchdog_s / WATCHDOG_RESETS
        self.control = control
        payload_kg = setup.payload_kg  # the stream's may still be from before
        if payload_kg is None and self._has_payload:
            payload_kg = self._receive.getPayload()
        return True, {"tcp": tcp, "payload_kg": payload_kg}

    def _plays(self) -> bool:
        """Wait for a program that was uploaded again: the library itself does not, and refuses
        commands until it plays."""
        end_s = time.monotonic() + STARTS_S
        while not self._plays_on():
            if time.monotonic() > end_s:
                return False
            time.sleep(OBEY_S)
        return True

    def _plays_on(self) -> bool:
        return bool(self._receive.getRuntimeState() == PLAYING)

    def _kick(self) -> None:
        if self.control is not None and time.monotonic() - self._kicked_s > self._kick_s:
            self._notice_starving()
            self.control.kickWatchdog()
            self._kicked_s = time.monotonic()

    def _notice_starving(self, *silent_s: float) -> None:
        """From the last reset, from the time between two states, or from that in which what was
        sent was not answered: both ``silent_s``."""
        now_s = time.monotonic()
        if max(now_s - self._kicked_s, *silent_s, 0.0) > STARVED_SHARE * self._watchdog_s:
            self._starved_s = now_s

    def _begin_operation(self) -> None:
        """Moves are reported by another stream than the poses, and may lag behind them."""
        self._before = (self._operation(), time.monotonic())

    def _operation(self) -> int:
        return int(self.control.getAsyncOperationProgressEx().operationId())

    def _busy(self) -> bool:
        if (control := self.control) is None:
            return False
        status = control.getAsyncOperationProgressEx()
        number, asked_s = self._before
        if status.operationId() == number and time.monotonic() - asked_s < BEGINS_S:
            return True  # not yet reported
        return bool(status.isAsyncOperationRunning())


def whole_state(
    receive: Any, last_s: float, busy: Callable[[], bool] = lambda: False
) -> State | None:
    """A sample later than ``last_s`` whose fields belong together: the getters are separate, so
    the time is read again after them and must not have moved on."""
    before_s = receive.getTimestamp()
    if before_s == last_s:
        return None
    state = State(
        before_s, time.monotonic(), tuple(receive.getActualTCPPose()),
        tuple(receive.getActualTCPForce()), tuple(receive.getTargetTCPSpeed()),
        int(receive.getSafetyMode()), int(receive.getRobotMode()), int(receive.getRuntimeState()),
        receive.getSpeedScaling() * receive.getTargetSpeedFraction(), busy(),
        teaches=bool(receive.getRobotStatus() & TEACH_BIT),
    )  # fmt: skip
    return state if receive.getTimestamp() == before_s and before_s > 0 else None
