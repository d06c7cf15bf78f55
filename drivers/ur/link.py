"""One robot: preflight, the client's process, the newest state, commands with deadlines.

A stage and a sensor on the same host share one link; it closes with its last user.
"""

import socket
import struct
import threading
import time
from collections import deque
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import wait
from typing import Any

from drivers.errors import ConfigError, DeviceAbsent, DeviceFault
from drivers.ur.client import READY, Setup, State, serve

RTDE_PORT, DASHBOARD_PORT, SCRIPT_PORT = 30004, 29999, 30003
PREFLIGHT_S = 1.0
CONNECT_S = 9.0  # the library itself waits 5 s for its program to start
COMMAND_S = 0.5
STOP_S = 0.1
STALE_S = 0.1
LONGEST_S = 20.0  # of samples kept for a reader that is late
PLAYING, RUNNING = 2, 7
SAFETY = {
    2: "protective stop: clear it on the pendant, and find out why",
    3: "recovery mode: move the arm out of its safety limits on the pendant",
    4: "safeguard stop: close the safeguard",
    5: "emergency stop of the cell",
    6: "emergency stop of the robot",
    7: "emergency stop: release the button and restart the robot",
    8: "safety violation",
    9: "safety fault: restart the controller",
    10: "stopped by the safety system",
}
MODES = {
    -1: "no controller", 0: "disconnected", 1: "confirming safety", 2: "booting", 3: "power off",
    4: "power on, not started", 5: "idle: release the brakes", 6: "back-drive", 8: "updating",
}  # fmt: skip


def preflight(name: str, setup: Setup) -> None:
    """See within a second per port that a controller answers. Raises `DeviceAbsent`."""
    ports = (RTDE_PORT, DASHBOARD_PORT, SCRIPT_PORT) if setup.control else (RTDE_PORT,)
    for port in ports:
        try:
            with socket.create_connection((setup.host, port), PREFLIGHT_S) as line:
                line.settimeout(PREFLIGHT_S)
                if port == RTDE_PORT:
                    line.sendall(struct.pack(">HBH", 5, ord("V"), 2))
                    answer = line.recv(4)
                    if answer[2:] != b"V\x01":
                        raise DeviceAbsent(name, f"{setup.host}:{port} speaks no RTDE version 2")
                elif port == DASHBOARD_PORT:
                    line.recv(64)
        except TimeoutError:
            raise DeviceAbsent(
                name, f"{setup.host}:{port} does not answer within {PREFLIGHT_S:g} s"
            ) from None
        except OSError as error:
            raise DeviceAbsent(
                name, f"{setup.host}:{port}: {error.strerror or error}; is the robot on, and the "
                "host in the rig file right?"
            ) from None  # fmt: skip


class Link:
    """A running client. `Link.state` raises what is wrong instead of giving an old state."""

    def __init__(self, name: str, setup: Setup) -> None:
        preflight(name, setup)
        self.name = name
        self.setup = setup
        self.users = 0
        self._lock = threading.Lock()
        self._fresh = threading.Condition()
        self._state: State | None = None
        self._samples: deque[State] = deque(maxlen=int(LONGEST_S * setup.frequency_hz))
        self._recent: deque[State] = deque(maxlen=int(STALE_S * setup.frequency_hz) + 2)
        self._answers: dict[int, tuple[bool, str]] = {}
        self._number = READY
        self._gone = ""
        context = get_context("spawn")
        self._states, states = context.Pipe(duplex=False)
        self._commands, commands = context.Pipe()
        self._process = context.Process(target=serve, args=(setup, states, commands), daemon=True)
        self._process.start()
        states.close()
        commands.close()
        self._thread = threading.Thread(target=self._follow, name=f"palpate {name}", daemon=True)
        self._thread.start()
        ready, why = self._answer(READY, CONNECT_S)
        if not ready or not self._first():
            self._fail(why or "no data")
        self._playing()

    def state(self) -> State:
        """The newest. Raises `DeviceFault` when it is old, or the robot is not able to work."""
        state = self._state
        if self._gone or state is None:
            raise DeviceFault(self.name, f"connection lost: {self._gone or 'not connected'}")
        age_s = time.monotonic() - state.arrival_s
        if age_s > STALE_S:
            raise DeviceFault(self.name, f"the robot has sent nothing for {age_s:.2f} s")
        for bit, words in SAFETY.items():
            if state.safety_bits >> bit & 1:
                raise DeviceFault(self.name, words)
        # A playing program implies a running robot; the mode only tells why none plays.
        if state.runtime_state != PLAYING and state.robot_mode != RUNNING:
            told = MODES.get(state.robot_mode, str(state.robot_mode))
            raise DeviceFault(self.name, f"the robot is not running ({told})")
        if self.setup.control and state.runtime_state != PLAYING:
            raise DeviceFault(self.name, "its control program has stopped: connect again")
        return state

    def earlier(self, by_s: float) -> State | None:
        """The state that was ``by_s`` before the newest, None if that is not known (yet)."""
        with self._fresh:
            newest = self._recent[-1].timestamp_s
            old = [s for s in self._recent if s.timestamp_s <= newest - by_s]
        return old[-1] if old else None

    def samples(self, timeout_s: float) -> list[State]:
        """All states since the last call, waiting for one. Raises `DeviceFault` when lost."""
        with self._fresh:
            if not self._samples:
                self._fresh.wait(timeout_s)
            taken = list(self._samples)
            self._samples.clear()
        if not taken:
            self.state()
        return taken

    def command(self, name: str, *arguments: Any, timeout_s: float = COMMAND_S) -> None:
        """Have a command obeyed. Raises `DeviceFault` if refused, or not answered in time."""
        done, why = self._answer(self._send(name, arguments), timeout_s)
        if not done:
            self.state()  # says more than the library does
            raise DeviceFault(self.name, f"{name} refused" + (f": {why}" if why else ""))

    def stop(self, deceleration_m_s2: float) -> None:
        """Halt: by the program, or if that does not answer by the dashboard. Never raises."""
        with suppress(DeviceFault, OSError):
            done, _ = self._answer(self._send("stop", (deceleration_m_s2,)), STOP_S)
            if done:
                return
        with suppress(OSError), socket.create_connection(
            (self.setup.host, DASHBOARD_PORT), STOP_S
        ) as line:  # fmt: skip
            line.settimeout(STOP_S)
            with suppress(TimeoutError):
                line.recv(64)  # it greets before it listens
            line.sendall(b"stop\n")
            line.recv(64)  # closing before the answer could lose the order

    def close(self) -> None:
        """End the client, by force if it does not end by itself."""
        self._gone = self._gone or "closed"
        self._commands.close()
        self._process.join(timeout=1.5)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(timeout=1.0)
        self._thread.join(timeout=1.0)

    def _fail(self, why: str) -> None:
        """Give up connecting, in the robot's words if it has any."""
        state = self._state
        bits = [] if state is None else [w for b, w in SAFETY.items() if state.safety_bits >> b & 1]
        self.close()
        raise DeviceAbsent(self.name, f"no connection to {self.setup.host}: {(*bits, why)[0]}")

    def _send(self, name: str, arguments: tuple[Any, ...]) -> int:
        with self._lock:
            self._number += 1
            try:
                self._commands.send((self._number, name, arguments))
            except (OSError, ValueError):
                why = self._gone or "the robot's client has ended"
                raise DeviceFault(self.name, f"connection lost: {why}") from None
            return self._number

    def _answer(self, number: int, timeout_s: float) -> tuple[bool, str]:
        with self._fresh:
            told = self._fresh.wait_for(
                lambda: number in self._answers or bool(self._gone), timeout_s
            )
            if number in self._answers:
                return self._answers.pop(number)
        return False, self._gone or ("" if told else f"no answer within {timeout_s:g} s")

    def _first(self) -> bool:
        with self._fresh:
            return self._fresh.wait_for(lambda: self._state is not None, PREFLIGHT_S)

    def _playing(self) -> None:
        """Wait for a state from after the program's start; `Link.state` tells if none comes."""
        with self._fresh:
            self._fresh.wait_for(
                lambda: bool(self._gone) or not self.setup.control
                or (self._state is not None and self._state.runtime_state == PLAYING),
                COMMAND_S,
            )  # fmt: skip

    def _follow(self) -> None:
        """Take in what the client sends until it ends."""
        try:
            while True:
                for pipe in wait([self._states, self._commands]):
                    got: Any = self._states.recv() if pipe is self._states else None
                    told: Any = self._commands.recv() if pipe is self._commands else None
                    with self._fresh:
                        if got is not None:
                            self._samples.extend(got)
                            self._recent.extend(got)
                            self._state = got[-1]
                        if told is not None:
                            self._answers[told[0]] = told[1:]
                        self._fresh.notify_all()
        except (EOFError, OSError):
            with self._fresh:
                self._gone = self._gone or "the robot's client has ended"
                self._fresh.notify_all()


_links: dict[str, Link] = {}
_opening = threading.Lock()


def take_link(name: str, setup: Setup) -> Link:
    """The link to a host, opened by the first user. Raises `DeviceAbsent`, or `ConfigError` where
    it is open at another rate."""
    with _opening:
        link = _links.get(setup.host)
        if link is None or (setup.control and not link.setup.control):
            link = _links[setup.host] = Link(name, setup)
        elif link.setup.frequency_hz != setup.frequency_hz:
            raise ConfigError(
                f"{name}: {setup.frequency_hz:g} Hz, but {link.name} has opened {setup.host} at "
                f"{link.setup.frequency_hz:g} Hz: one robot sends at one rate"
            )
        link.users += 1
        return link


def leave_link(link: Link) -> None:
    """Close it if nobody else uses it."""
    with _opening:
        link.users -= 1
        if link.users <= 0:
            if _links.get(link.setup.host) is link:
                del _links[link.setup.host]
            link.close()
