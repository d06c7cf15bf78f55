"""Whether what is sent to a controller arrives there.

A reset of the watchdog is not answered. A question about the controller's version is, at any time
and by the server that takes the resets too; so one is always under way, on a connection of its own.
"""

import socket
import struct
import threading
import time
from contextlib import suppress

from drivers.ur.version import ANSWER_BYTES, CONTROLLER, RTDE_PORT

ASK_S = 0.02
CONNECT_S = 1.0


class Echo:
    """Asks until ``end`` is set; a controller that cannot be asked counts as one that answers."""

    def __init__(self, host: str, end: threading.Event) -> None:
        self._host, self._end = host, end
        self._asked_s: float | None = None
        threading.Thread(target=self._ask, name="ur echo", daemon=True).start()

    def unanswered_s(self) -> float:
        """For how long the question under way has had no answer [s]; 0 where none is."""
        asked_s = self._asked_s
        return 0.0 if asked_s is None else time.monotonic() - asked_s

    def _ask(self) -> None:
        question = struct.pack(">HB", 3, CONTROLLER)
        with suppress(OSError), socket.create_connection(
            (self._host, RTDE_PORT), CONNECT_S
        ) as line:  # fmt: skip
            line.settimeout(None)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while not self._end.wait(ASK_S):
                self._asked_s = time.monotonic()
                line.sendall(question)
                if len(line.recv(ANSWER_BYTES, socket.MSG_WAITALL)) < ANSWER_BYTES:
                    break
                self._asked_s = None
        self._asked_s = None
