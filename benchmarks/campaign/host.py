"""What strikes from outside the scan: signals, terminals, limits of the machine, files, people."""

import os
import resource
import signal
import socket
import sqlite3
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from campaign.faults import Fault
from campaign.scanning import Scan, start
from probe.scan.remote import DOOR, NotRunning, ask, control_path

FLOOD = 300
STOP_OUTPUT, START_OUTPUT = b"\x13", b"\x11"  # ctrl-S, ctrl-Q
UNREAD_S = 6.0
SIGNALS = {
    "SIGINT": signal.SIGINT,
    "SIGTERM": signal.SIGTERM,
    "SIGHUP": signal.SIGHUP,
    "SIGQUIT": signal.SIGQUIT,
    "SIGKILL": signal.SIGKILL,
}
TYPED = {"ctrl-c typed": b"\x03", "ctrl-backslash typed": b"\x1c"}
INSIDE = {"interpreter busy": b"b", "interpreter held": b"h", "date set": b"d"}


@dataclass
class Host:
    """Strikes a scan, at once or a moment later: call `due` often, `close` at the end."""

    scan: Scan
    out: Path
    rig: Path
    second: Scan | None = None
    struck: list[str] = field(default_factory=list)
    _later: list[tuple[float, Callable[[], None]]] = field(default_factory=list)
    _sockets: list[socket.socket] = field(default_factory=list)
    _locks: list[sqlite3.Connection] = field(default_factory=list)

    def strike(self, fault: Fault) -> None:
        """Do what the kind says, to the scan as it is now."""
        self.struck.append(fault.kind.name)
        with suppress(ProcessLookupError, NotRunning, FileNotFoundError):
            self._strike(fault.kind.name, fault.size)

    def due(self) -> None:
        """Do what was put off until now."""
        now = time.monotonic()
        for item in [item for item in self._later if item[0] <= now]:
            self._later.remove(item)
            with suppress(ProcessLookupError, NotRunning):
                item[1]()

    def close(self) -> None:
        """Leave nothing behind."""
        for peer in self._sockets:
            peer.close()
        for connection in self._locks:
            connection.close()

    @property
    def run_file(self) -> Path | None:
        """The file that the scan writes."""
        return next(iter(sorted(self.out.glob("*.run"))), None)

    @property
    def both_drive(self) -> bool:
        """Whether the second program has a run while the scan's own goes on: as long as it does it
        may be asked, and afterwards another may have the stage."""
        second = self.out.with_name("second")
        return any(second.glob("*.run")) and any(self.out.glob("*.control"))

    def _strike(self, name: str, size: tuple[float, float, float]) -> None:
        scan, (a, b, _) = self.scan, size
        if name in SIGNALS:
            os.kill(scan.pid, SIGNALS[name])
        elif name.endswith(" to the group"):
            os.killpg(scan.pid, SIGNALS[name.split()[0]])
        elif name in TYPED:
            self._type(TYPED[name])
        elif name in INSIDE:
            os.write(scan.inside, INSIDE[name])
        elif name in ("abort", "stop"):
            self._ask(name)
        elif name == "SIGINT storm":
            for n in range(3 + int(8 * a)):
                number = signal.SIGINT if n % 2 else signal.SIGTERM
                self._after(n * 0.05 * b, lambda number=number: os.kill(scan.pid, number))
        elif name.startswith("guards"):
            kill = name.endswith("killed")
            for pid in self._guards():
                os.kill(pid, signal.SIGKILL if kill else signal.SIGSTOP)
        elif name.startswith("SIGSTOP"):
            send = os.killpg if name.endswith("group") else os.kill
            send(scan.pid, signal.SIGSTOP)
            self._after(0.05 + 1.4 * a, lambda: send(scan.pid, signal.SIGCONT))
        elif name == "ctrl-z typed, then fg":
            self._type(b"\x1a")
            self._after(0.05 + 1.4 * a, lambda: os.killpg(scan.pid, signal.SIGCONT))
        elif name == "terminal closed":
            scan.close_terminal()
        elif name == "terminal not read":
            self._type(STOP_OUTPUT)
            self._after(UNREAD_S, lambda: self._type(START_OUTPUT))
        elif name == "pause and resume":
            self._ask("pause")
            self._after(0.3 + a, lambda: self._ask("resume"))
        elif name == "second program":
            answer = self.out.with_name("second.json")
            elsewhere = str(self.out.with_name("second"))
            self.second = start(
                ["scan", str(self.rig), "--out", elsewhere, "--json"], self.out.parent, answer
            )
        else:
            self._spoil(name, a)

    def _guards(self) -> list[int]:
        """The process with the devices: of the scan's children the one that has threads. None once
        the scan has ended."""
        tasks = Path(f"/proc/{self.scan.pid}/task").glob("*/children")
        pids = [pid for task in tasks for pid in task.read_text(encoding="ascii").split()]
        threads = {pid: len(list(Path(f"/proc/{pid}/task").iterdir())) for pid in pids}
        return [int(pid) for pid in sorted(threads, key=lambda pid: threads[pid])[-1:]]

    def _spoil(self, name: str, a: float) -> None:
        pid = self.scan.pid
        if name == "no memory":
            pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[0])
            limit = pages * resource.getpagesize() + int(4e6 * a)
            resource.prlimit(pid, resource.RLIMIT_AS, (limit, limit))
        elif name == "no descriptors":
            count = len(list(Path(f"/proc/{pid}/fd").iterdir()))
            resource.prlimit(pid, resource.RLIMIT_NOFILE, (count, count))
        elif name == "no space":
            with suppress(OSError), (self.out / "filler").open("wb", buffering=0) as file:
                while True:
                    file.write(b"\0" * 4096)
        elif name == "connection flood":
            self._flood()
        elif name.startswith("run file") and (run := self.run_file) is not None:
            self._touch(name, run, a)

    def _touch(self, name: str, run: Path, a: float) -> None:
        if name == "run file deleted":
            run.unlink()
        elif name == "run file replaced":
            other = run.with_name("other")
            with suppress(OSError):  # on a full disk it is empty
                other.write_bytes(b"something else" * int(1 + 100 * a))
            with suppress(OSError):  # and a full folder has no room for another
                other.replace(run)
        else:
            held = sqlite3.connect(run, isolation_level=None, timeout=0.2)
            self._locks.append(held)
            with suppress(sqlite3.OperationalError):
                held.execute("BEGIN IMMEDIATE")
            self._after(4.0 if name.endswith("long") else 0.05 + 0.4 * a, held.close)

    def _flood(self) -> None:
        run = self.run_file
        if run is None:
            return
        door = Path(control_path(run).read_text(encoding="utf-8")) / DOOR
        peer = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        peer.setblocking(False)
        self._sockets.append(peer)
        for _ in range(FLOOD):
            with suppress(BlockingIOError):
                peer.sendto(b"rewind", str(door))

    def _ask(self, word: str) -> None:
        if (run := self.run_file) is not None:
            ask(run, word)

    def _type(self, keys: bytes) -> None:
        if self.scan.terminal is not None:
            os.write(self.scan.terminal, keys)

    def _after(self, seconds: float, action: Callable[[], None]) -> None:
        self._later.append((time.monotonic() + seconds, action))
