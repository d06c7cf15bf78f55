"""The process that holds the ur-rtde client. It may hang or crash: the scan's process goes on.

ur-rtde hangs with the interpreter locked where a controller accepts and stays silent, blocks for
minutes where one vanishes in a move, and has crashed on dropped connections; so nothing of it
runs where the engine runs.
"""

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

READY = 0  # number of the answer that says the client is connected
READ_S = 2e-4
SEND_S = 0.004
WATCHDOG_HZ = 5.0  # the robot's program stops itself if it hears less often from us
KICK_S = 0.05
HASTE = -10
"""Nice value: samples and the watchdog wait for nobody's computing."""
UNABLE = 0b111_1111_1100
"""Safety bits other than normal and reduced."""
VARIABLES = [
    "timestamp", "actual_TCP_pose", "actual_TCP_force", "robot_mode", "safety_status_bits",
    "robot_status_bits", "runtime_state",
]  # fmt: skip


class State(NamedTuple):
    """One whole sample: the controller's time, and what was true then (SI, base frame).

    ``arrival_s`` is on this machine's monotonic clock.
    """

    timestamp_s: float
    arrival_s: float
    pose: tuple[float, ...]
    wrench: tuple[float, ...]
    safety_bits: int
    robot_mode: int
    runtime_state: int


class Setup(NamedTuple):
    """What the client needs to know. ``tcp`` and ``payload_kg`` are left as they are if None."""

    host: str
    frequency_hz: float
    control: bool
    tcp: tuple[float, ...] | None
    payload_kg: float | None
    payload_centre_m: tuple[float, float, float]


def serve(setup: Setup, states: Connection, commands: Connection) -> None:
    """Body of the process: stream states, obey commands, until the other end closes."""
    import rtde_receive

    _silence()
    with suppress(OSError):  # only root may
        os.setpriority(os.PRIO_PROCESS, 0, HASTE)
    control, end = None, threading.Event()
    try:
        receive = rtde_receive.RTDEReceiveInterface(setup.host, setup.frequency_hz, VARIABLES)
        threading.Thread(target=_stream, args=(receive, states, end), daemon=True).start()
        if setup.control and receive.getSafetyStatusBits() & UNABLE:
            time.sleep(10 * SEND_S)  # the state goes first, it says which
            commands.send((READY, False, "its safety system does not let it move"))
            return
        control = _control(setup) if setup.control else None
    except RuntimeError as error:
        commands.send((READY, False, str(error)))
        return
    commands.send((READY, True, ""))
    try:
        _obey(control, commands, end)
    except (EOFError, OSError):
        pass  # the scan's process has gone: leave the arm at rest
    finally:
        end.set()
        if control is not None:
            control.stopScript()


def _silence() -> None:
    """The library talks to standard output and error, which belong to the scan."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)


def _control(setup: Setup) -> Any:
    import rtde_control

    control = rtde_control.RTDEControlInterface(setup.host, setup.frequency_hz)
    if setup.tcp is not None:
        control.setTcp(list(setup.tcp))
    if setup.payload_kg is not None:
        control.setPayload(setup.payload_kg, list(setup.payload_centre_m))
    control.setWatchdog(WATCHDOG_HZ)
    return control


def _stream(receive: Any, states: Connection, end: threading.Event) -> None:
    """Send every new sample; a few at a time, so that the pipe is not the bottleneck."""
    waiting: list[State] = []
    last_s, sent_s = -1.0, 0.0
    while not end.is_set():
        state = whole_state(receive, last_s)
        if state is not None:
            last_s = state.timestamp_s
            waiting.append(state)
        now_s = time.monotonic()
        if waiting and now_s - sent_s >= SEND_S:
            sent_s = now_s
            try:
                states.send(waiting)
            except OSError:
                return
            waiting = []
        time.sleep(READ_S)


def whole_state(receive: Any, last_s: float) -> State | None:
    """A sample later than ``last_s`` whose fields belong together: the getters are separate, so
    the time is read again after them and must not have moved on."""
    before_s = receive.getTimestamp()
    if before_s == last_s:
        return None
    state = State(
        before_s, time.monotonic(), tuple(receive.getActualTCPPose()),
        tuple(receive.getActualTCPForce()), int(receive.getSafetyStatusBits()),
        int(receive.getRobotMode()), int(receive.getRuntimeState()),
    )  # fmt: skip
    return state if receive.getTimestamp() == before_s and before_s > 0 else None


def _obey(control: Any, commands: Connection, end: threading.Event) -> None:
    """One command at a time; between them the robot's watchdog is kept content."""
    calls: dict[str, Callable[..., Any]] = {}
    if control is not None:
        calls = {
            "move": lambda pose, v, a: control.moveL(list(pose), v, a, True),
            "stop": lambda a: control.stopL(a, True),
            "zero": control.zeroFtSensor,
        }
    kicked_s = 0.0
    while not end.is_set():
        if control is not None and time.monotonic() - kicked_s > KICK_S:
            control.kickWatchdog()
            kicked_s = time.monotonic()
        if not commands.poll(0.001):
            continue
        number, name, arguments = commands.recv()
        try:
            done = calls[name](*arguments)
            commands.send((number, done is not False, ""))
        except RuntimeError as error:
            commands.send((number, False, str(error)))
