"""Before a client is started: does a controller answer, and which one is it?"""

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from drivers.core.errors import DeviceAbsent

RTDE_PORT, DASHBOARD_PORT, SCRIPT_PORT = 30004, 29999, 30003
PREFLIGHT_S = 1.0
CB3, POLYSCOPE_X = 3, 10
CB3_HZ, E_SERIES_HZ = 125.0, 500.0
CONTROLLER = ord("v")
ANSWER_BYTES = 19  # of the controller's version


class Controller(NamedTuple):
    """Version of the controller's software."""

    major: int
    minor: int
    bugfix: int
    build: int

    @property
    def fastest_hz(self) -> float:
        """How often it sends at most (Universal Robots, "RTDE guide")."""
        return CB3_HZ if self.major == CB3 else E_SERIES_HZ

    @property
    def finds_contact(self) -> bool:
        """Its programs may ask it for contact; in an older one the library would report one at
        once, and not stop (`rtde_control.script` of ur-rtde 1.6.5)."""
        return (self.major, self.minor) >= (5, 4)

    @property
    def reports_payload(self) -> bool:
        """It knows the output ``payload``, as `rtde_receive_interface.cpp` of ur-rtde 1.6.5 asks
        for it; an older one would refuse all others with it."""
        return self[:3] >= (5, 5, 1) or (3, 11) <= self[:2] < (4, 0)

    @property
    def described(self) -> str:
        """Its name in words."""
        family = {CB3: "CB3, PolyScope", POLYSCOPE_X: "PolyScope X"}.get(self.major, "PolyScope")
        return f"{family} {self.major}.{self.minor}.{self.bugfix}"


def ask_version(name: str, host: str) -> Controller:
    """See within a second that a controller answers, and which. Raises `DeviceAbsent`."""
    with _connected(name, host, RTDE_PORT) as line:
        line.sendall(struct.pack(">HBH", 5, ord("V"), 2))
        if line.recv(4)[2:] != b"V\x01":
            raise DeviceAbsent(name, f"{host}:{RTDE_PORT} speaks no RTDE version 2")
        line.sendall(struct.pack(">HB", 3, CONTROLLER))
        answer = line.recv(ANSWER_BYTES)
        if len(answer) != ANSWER_BYTES or answer[2] != CONTROLLER:
            raise DeviceAbsent(name, f"{host}:{RTDE_PORT} does not report its version")
        return Controller(*struct.unpack(">4I", answer[3:]))


def check_control(name: str, host: str, controller: Controller) -> None:
    """See that the ports for control are open, and the robot one that this driver knows.

    Raises `DeviceAbsent`.
    """
    if controller.major >= POLYSCOPE_X:
        raise DeviceAbsent(
            name, f"{host} runs {controller.described}, which has no dashboard server to stop it "
            "by: only reading is supported; moving needs PolyScope 3 or 5"
        )  # fmt: skip
    if controller.minor < 4:
        raise DeviceAbsent(
            name, f"{host} runs {controller.described}, which ur-rtde cannot control, as it asks "
            "for no answers there: moving needs PolyScope 5.4, or 3.4 of a CB3"
        )  # fmt: skip
    with _connected(name, host, DASHBOARD_PORT) as line:
        line.recv(64)
    with _connected(name, host, SCRIPT_PORT):
        pass


@contextmanager
def _connected(name: str, host: str, port: int) -> Iterator[socket.socket]:
    """A connection whose failures are reported as an absent robot."""
    try:
        with socket.create_connection((host, port), PREFLIGHT_S) as line:
            yield line
    except TimeoutError:
        raise DeviceAbsent(
            name, f"{host}:{port} does not answer within {PREFLIGHT_S:g} s"
        ) from None
    except OSError as error:
        raise DeviceAbsent(
            name, f"{host}:{port}: {error.strerror or error}; is the robot on, and the "
            "host in the rig file right?"
        ) from None  # fmt: skip
