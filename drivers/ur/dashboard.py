"""The dashboard server: orders that the controller obeys whatever its program does.

Universal Robots, "Dashboard server, e-Series".
"""

import socket
from contextlib import suppress

from drivers.ur.version import DASHBOARD_PORT

DASHBOARD_S = 0.1
END_PROGRAM, CLOSE_BRAKES, IS_REMOTE = "stop", "power off", "is in remote control"


def tell(host: str, order: str) -> str:
    """What is answered to ``order``; empty if nothing comes. Never raises."""
    with suppress(OSError), socket.create_connection((host, DASHBOARD_PORT), DASHBOARD_S) as line:
        line.settimeout(DASHBOARD_S)
        with suppress(TimeoutError):
            line.recv(64)  # it greets before it listens
        line.sendall(order.encode() + b"\n")
        return line.recv(64).decode("ascii", "replace").strip()  # closed before, it may be lost
    return ""
