"""An ATI Net F/T box on loopback: RDT records over UDP and its calibration page over HTTP."""

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from sim_backend.arrays import Array
from sim_backend.emulators.serving import on_this_machine
from sim_backend.phantom.phantom import Phantom

COUNTS_PER_N = 1_000_000
COUNTS_PER_NM = 1_000_000
HEADER = 0x1234
STOP, STREAM, BIAS = 0, 2, 0x42
PAGE = f"""<?xml version="1.0" encoding="UTF-8"?>
<netft><prodname>Ethernet F/T</prodname><cfgcpf>{COUNTS_PER_N}</cfgcpf>
<cfgcpt>{COUNTS_PER_NM}</cfgcpt><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu></netft>
"""

SELDOM = 200
"""One record in this many comes twice, or after the next."""


class NetFtBox:
    """A running box. ``host``, ``rdt_port`` and ``http_port`` are what a rig file gives."""

    faults = ("silence", "drop", "garbage", "lossy", "late", "doubled", "swapped")

    def __init__(
        self, phantom: Phantom, host: str, ports: tuple[int, int], rate_hz: float, noise_n: float
    ) -> None:
        self._phantom = phantom
        self._rate_hz = rate_hz
        self._noise_n = noise_n
        self._rng = np.random.default_rng(0)
        self._fault: str | None = None
        self._client: tuple[str, int] | None = None
        self._bias_n = 0.0
        self._kept = b""
        self._sequence = 0
        host = on_this_machine(host)
        self.asked = 0  # how often for its page
        self._page = ThreadingHTTPServer((host, ports[1]), self._answer)
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind((host, ports[0]))
        self._udp.settimeout(0.001)
        self.host = host
        self.rdt_port: int = self._udp.getsockname()[1]
        self.http_port: int = self._page.server_address[1]
        self.address = f"host = {host!r}, rdt_port = {self.rdt_port}, http_port = {self.http_port}"
        self._end = threading.Event()
        self._threads = [
            threading.Thread(target=self._run, name="emulated netft", daemon=True),
            threading.Thread(
                target=self._page.serve_forever,
                args=(0.05,),
                name="emulated netft page",
                daemon=True,
            ),
        ]
        for thread in self._threads:
            thread.start()

    def fail(self, fault: str | None) -> None:
        """Begin a fault of ``faults``; None: mend. Raises `ValueError`.

        ``silence`` sends nothing more, ``drop`` also hears nothing. Of the records ``lossy`` leaves
        out one in five and ``garbage`` makes random bytes of all; ``late`` sends each 0.2 s late;
        ``doubled`` sends one in `SELDOM` twice, ``swapped`` after the next.
        """
        if fault is not None and fault not in self.faults:
            raise ValueError(f"fault {fault!r}: known are {', '.join(self.faults)}")
        self._fault = fault

    def close(self) -> None:
        """End it."""
        self._end.set()
        self._page.shutdown()
        for thread in self._threads:
            thread.join(timeout=5.0)
        self._page.server_close()
        self._udp.close()

    def _answer(self, *connection: Any) -> "_Page":
        self.asked += 1
        return _Page(*connection)

    def _run(self) -> None:
        began_s, sent = time.monotonic(), 0
        while not self._end.is_set():
            self._listen()
            now_s = time.monotonic()
            due = int((now_s - began_s) * self._rate_hz) - sent
            # a box measures in time, however late this thread sends
            ago_s = now_s - began_s - np.arange(sent, sent + due) / self._rate_hz
            sent += due
            self._stream(ago_s)

    def _stream(self, ago_s: Array) -> None:
        """Send the records that were due so long ago: one question to the phantom for all."""
        first, self._sequence = self._sequence + 1, (self._sequence + len(ago_s)) % 2**32
        if self._client is None or self._fault in ("silence", "drop") or not len(ago_s):
            return
        noise_n = self._noise_n * self._rng.standard_normal(len(ago_s))
        measured_n = self._bias_n - self._force_n(ago_s) + noise_n
        for sequence, force_n in enumerate(measured_n, first):
            self._send(sequence % 2**32, force_n)

    def _listen(self) -> None:
        try:
            request, sender = self._udp.recvfrom(64)
        except (TimeoutError, ConnectionError):
            return
        if len(request) < 8 or self._fault == "drop":
            return
        header, command, _ = struct.unpack(">HHI", request[:8])
        if header != HEADER:
            return
        if command == STREAM:
            self._client = sender
        elif command == STOP:
            self._client = None
        elif command == BIAS:
            self._bias_n = float(self._force_n(np.zeros(1))[0])

    def _send(self, sequence: int, measured_n: float) -> None:
        # its sequence, that of the 7000 Hz at which a box samples, status; forces, torques
        counts = round(COUNTS_PER_N * measured_n)
        record = struct.pack(">3I6i", sequence, 7 * sequence % 2**32, 0, 0, 0, counts, 0, 0, 0)
        if self._fault == "lossy" and sequence % 5 == 0:
            return
        if self._fault == "garbage":
            record = self._rng.bytes(int(self._rng.integers(1, 35)))
        if self._fault == "late":
            time.sleep(0.2)
        records = [record]
        if self._kept:  # it is overtaken by this one
            records, self._kept = [record, self._kept], b""
        elif self._fault == "doubled" and sequence % SELDOM == 0:
            records = [record, record]
        elif self._fault == "swapped" and sequence % SELDOM == 0:
            records, self._kept = [], record
        try:
            for one in records:
                if self._client is not None:
                    self._udp.sendto(one, self._client)
        except ConnectionError:
            self._client = None

    def _force_n(self, ago_s: Array) -> Array:
        return self._phantom.force_n(self._phantom.clock.now() - ago_s)


class _Page(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        body = PAGE.encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/xml")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@contextmanager
def emulate(
    phantom: Phantom,
    *,
    at: str = "127.0.0.1",
    rdt_port: int = 49152,
    http_port: int = 8049,
    rate_hz: float = 1000.0,
    noise_n: float = 0.001,
) -> Iterator[NetFtBox]:
    """Serve a box on the address ``at``; port 0: any free one.

    ``rdt_port`` is the real box's. Its page is on port 80, which only root may serve; 8049 stands
    for it.
    """
    box = NetFtBox(phantom, at, (rdt_port, http_port), rate_hz, noise_n)
    try:
        yield box
    finally:
        box.close()
