"""A UR controller on loopback: RTDE, script port and dashboard, moving the phantom's tip.

``ur-rtde`` connects to it unmodified. Its ports are fixed by the library, so that each robot
needs an address of its own: 127.0.0.1, 127.0.0.2, ….
"""

import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from sim_backend.emulators.serving import on_this_machine
from sim_backend.emulators.ur import wire
from sim_backend.emulators.ur.kinematics import Inverse, anywhere
from sim_backend.emulators.ur.mounting import Mounting, Point
from sim_backend.emulators.ur.robot import (
    EMERGENCY_MODE,
    PROTECTIVE_MODE,
    STOP_L,
    TICK_S,
    Robot,
)
from sim_backend.phantom.phantom import Phantom

RTDE_PORT, DASHBOARD_PORT = 30004, 29999
CB3_HZ = 125.0
SCRIPT_PORTS = (30001, 30002, 30003)
LATE_S = 0.2
LAG_S = 0.1
AHEAD_S = 10.0
MISSED_S = 0.06  # as seen of a controller in a container
SLOW = 0.2
JITTER_S = 0.002
CATCH_UP = 0.3
"""What passes at least between two states to one client, over the period."""
LONGEST_BEHIND = 100
"""Cycles that are sent late; older ones are left out."""
BANNER = b"Connected: Universal Robots Dashboard Server\n"
DASHBOARD = {
    "PolyscopeVersion": "URSoftware 5.11.0.108249 (Dec 01 2021)",
    "get serial number": "20215500000",
    "is in remote control": "true",
    "robotmode": "Robotmode: RUNNING",
    "safetystatus": "Safetystatus: NORMAL",
    "get robot model": "UR5",
}
ORDERS = {
    "stop": (Robot.end_program, "Stopped"),
    "pause": (Robot.pause, "Pausing program"),
    "play": (Robot.resume, "Starting program"),
    "power off": (Robot.power_off, "Powering off"),
}
PAYLOAD_SINCE = {3: (3, 11, 0), 5: (5, 5, 1)}
"""The output `payload` came with these (Universal Robots, "RTDE guide")."""


Version = tuple[int, int, int, int]
E_SERIES: Version = (5, 11, 0, 108249)
CB3: Version = (3, 15, 0, 106331)
POLYSCOPE_X: Version = (10, 7, 0, 108)


class UrController:
    """A running controller; ``address`` is what a rig file gives as ``host``."""

    faults = ("protective stop", "emergency stop", "lost program", "silence", "drop", "garbage",
              "late", "mute", "blink", "no start", "other program", "slow slider", "missed cycles",
              "jitter", "late readings", "uplink stalls", "ignored stops", "paused", "freedrive",
              "local", "clock ahead", "slider at 0")  # fmt: skip

    def __init__(self, robot: Robot, host: str, version: Version = E_SERIES) -> None:
        self.address = host
        self.robot = robot
        self._version = version
        self._unknown = frozenset[str]()
        if version[:3] < PAYLOAD_SINCE.get(version[0], (0, 0, 0)):
            self._unknown = frozenset({"payload"})
        self.deaf_to: frozenset[str] = frozenset()
        """Orders at the dashboard that are answered and not obeyed."""
        self._fault: str | None = None
        self._rng = np.random.default_rng(0)
        self._end = threading.Event()
        self._open: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._servers = [
            self._serve(RTDE_PORT, self._rtde),
            self._serve(DASHBOARD_PORT, self._dashboard),
            *(self._serve(port, self._script) for port in SCRIPT_PORTS),
        ]
        self._start(self._go_on, "emulated ur")

    def fail(self, fault: str | None) -> None:
        """Begin a fault of ``faults``; None mends everything. Raises `ValueError`."""
        if fault is not None and fault not in self.faults:
            raise ValueError(f"fault {fault!r}: known are {', '.join(self.faults)}")
        match fault:
            case "protective stop":
                self.robot.protect(PROTECTIVE_MODE)
            case "emergency stop":
                self.robot.protect(EMERGENCY_MODE)
            case "lost program":
                self.robot.end_program()
            case "other program":
                self.robot.play_other()
            case "slow slider" | "slider at 0":
                self.robot.slide(SLOW if fault == "slow slider" else 0.0)
            case "missed cycles":
                self.robot.miss_cycles(MISSED_S)
            case "ignored stops":
                self.robot.ignores = frozenset({STOP_L})
            case "paused":
                self.robot.pause()
            case "freedrive":
                self.robot.teaches = True
                self.robot.pause()
            case "local":
                self.robot.end_program()
            case "clock ahead":
                self.robot.ahead_s += AHEAD_S
            case None:
                self.robot.clear()
        self.robot.stuck = fault == "no start"
        self._fault = fault
        if fault in ("drop", "blink"):
            for client in list(self._open):
                with suppress(OSError):
                    client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End all."""
        self._end.set()
        for thread in self._threads:
            thread.join(timeout=2.0)
        for server in self._servers:
            server.close()

    def _go_on(self) -> None:
        """The robot's own watchdog watches, whoever has stopped reading."""
        while not self._end.wait(TICK_S):
            self.robot.tick()

    def _serve(self, port: int, talk: Callable[[socket.socket], None]) -> socket.socket:
        server = socket.create_server((on_this_machine(self.address), port))
        server.settimeout(0.05)

        def accept() -> None:
            while not self._end.is_set():
                try:
                    client, _ = server.accept()
                except OSError:
                    continue
                if self._fault == "drop":
                    client.close()
                    continue
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._start(partial(self._session, client, talk), f"emulated ur {port}")

        self._start(accept, f"emulated ur {port} accept")
        return server

    def _start(self, work: Callable[[], None], name: str) -> None:
        thread = threading.Thread(target=work, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _session(self, client: socket.socket, talk: Callable[[socket.socket], None]) -> None:
        self._open.add(client)
        try:
            while self._fault == "mute" and not self._end.wait(0.05):
                pass
            talk(client)
        except (OSError, struct.error):
            pass  # the client went away, or sent what no package is
        finally:
            self._open.discard(client)
            client.close()

    def _rtde(self, client: socket.socket) -> None:
        buffer = bytearray()
        inputs: dict[int, wire.Recipe] = {}
        output: wire.Recipe | None = None
        robot = self.robot
        cycle, every, streaming = 0, 1, False
        while not self._end.is_set():
            # at most one state per wait: of two that arrive at once, a client drops the first
            wait_s = max(robot.until_s(cycle), CATCH_UP * robot.period_s)
            time.sleep(min(wait_s, robot.period_s))
            buffer += self._heard(client, socket.MSG_DONTWAIT)
            for kind, payload in wire.packages(buffer):
                if kind == wire.DATA:
                    recipe = inputs.get(payload[0])
                    if recipe is not None:
                        robot.written(recipe.unpack(payload[1:]))
                elif kind == wire.OUTPUTS:
                    (wanted_hz,) = struct.unpack_from(">d", payload)
                    every = max(round(1 / (wanted_hz * robot.period_s)), 1)
                    output = wire.Recipe(1, _names(payload[8:]), self._unknown)
                    self._send(client, wire.OUTPUTS, output.answer())
                elif kind == wire.INPUTS:
                    recipe = wire.Recipe(len(inputs) + 1, _names(payload))
                    inputs[recipe.number] = recipe
                    self._send(client, wire.INPUTS, recipe.answer())
                elif kind == wire.VERSION:
                    self._send(client, kind, b"\x01")
                elif kind == wire.CONTROLLER:
                    self._send(client, kind, struct.pack(">4I", *self._version))
                elif kind in (wire.START, wire.PAUSE):
                    streaming = kind == wire.START
                    self._send(client, kind, b"\x01")
            lag_s = LAG_S if self._fault == "late readings" and not inputs else 0.0
            behind = -(robot.until_s(cycle) + lag_s) / robot.period_s
            if behind < 0:
                continue
            if output is None or not streaming or behind > LONGEST_BEHIND:
                cycle += int(behind)
            elif self._fault != "silence":
                self._send(client, wire.DATA, output.pack(robot.outputs(cycle)))
            cycle += every

    def _heard(self, client: socket.socket, flags: int = 0) -> bytes:
        """What has arrived; where the way to the robot stalls, it arrives later."""
        if self._fault == "uplink stalls":
            self._end.wait(0.0 if flags else 0.05)
            return b""
        return _received(client, flags)

    def _send(self, client: socket.socket, kind: int, payload: bytes) -> None:
        if self._fault == "late":
            time.sleep(LATE_S)
        elif self._fault == "jitter":
            time.sleep(float(self._rng.exponential(JITTER_S)))
        data = wire.package(kind, payload)
        if self._fault == "garbage":
            data = self._rng.bytes(len(data))
        client.sendall(data)

    def _dashboard(self, client: socket.socket) -> None:
        client.settimeout(0.05)
        client.sendall(BANNER)
        text = ""
        while not self._end.is_set():
            text += self._heard(client).decode("ascii", "replace")
            while "\n" in text:
                line, _, text = text.partition("\n")
                client.sendall(self._dashboard_answer(line.strip()).encode() + b"\n")

    def _dashboard_answer(self, line: str) -> str:
        if line in ORDERS:
            order, answer = ORDERS[line]
            if line not in self.deaf_to:
                order(self.robot)
            return answer
        if line == "running":
            return f"Program running: {str(self.robot.playing).lower()}"
        if line == "is in remote control" and self._fault == "local":
            return "false"
        return DASHBOARD.get(line, f"could not understand: '{line}'")

    def _script(self, client: socket.socket) -> None:
        client.settimeout(0.05)
        text = ""
        while not self._end.is_set():
            text += self._heard(client).decode("ascii", "replace")
            if text.startswith("def ") and "\nend" in text[-8:]:
                self.robot.upload()
                text = ""


def _received(client: socket.socket, flags: int = 0) -> bytes:
    """What has arrived within the socket's timeout. Raises `ConnectionError` at its end."""
    try:
        data = client.recv(65536, flags)
    except (TimeoutError, BlockingIOError):
        return b""
    if not data:
        raise ConnectionError
    return data


def _names(payload: bytes) -> list[str]:
    return [name for name in payload.decode("ascii", "replace").split(",") if name]


@contextmanager
def emulate(
    phantom: Phantom,
    *,
    at: str = "127.0.0.1",
    rate_hz: float = 500.0,
    noise_n: float = 0.0005,
    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    reach_mm: float = 10_000.0,
    inverse: Inverse = anywhere,
    joint_limit_deg: float = 360.0,
    version: Version = E_SERIES,
    seed: int = 0,
    ready: Callable[[Point], bool] = lambda _target: True,
    contact_n: float = np.inf,
) -> Iterator[UrController]:
    """Serve a controller on the address ``at``.

    Base frame = scan frame turned by roll, pitch and yaw (``rotation_deg``, about the fixed x, y
    and z), then moved by ``origin_mm``. Poses beyond ``reach_mm`` of the base are out of reach, and
    those that ``inverse`` finds no joint angles for; angles beyond ``joint_limit_deg`` are not
    allowed. A move to a target (scan frame) that is not ``ready`` is held until it is.
    ``contact_n`` is the push that ``tool_contact`` takes for a contact. Nobody has published it for
    a real arm: whoever needs one gives it, and a range of them where it matters.
    """
    x, y, z = origin_mm
    turn = Rotation.from_euler("xyz", rotation_deg, degrees=True)
    mounting = Mounting(
        (1e-3 * x, 1e-3 * y, 1e-3 * z), turn, 1e-3 * reach_mm, inverse,
        float(np.radians(joint_limit_deg)),
    )  # fmt: skip
    rate_hz = min(rate_hz, CB3_HZ) if version[0] == 3 else rate_hz
    robot = Robot(phantom, mounting, noise_n, seed, 1 / rate_hz, ready, contact_n)
    controller = UrController(robot, at, version)
    try:
        yield controller
    finally:
        controller.close()
