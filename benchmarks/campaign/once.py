"""One run: the truth in one process, the scan in another, the faults, and what was found."""

import json
import multiprocessing
import os
import select
import shutil
import signal
import socket
import subprocess
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from campaign.arm import serve_arm
from campaign.faults import Draw
from campaign.host import Host
from campaign.rigs import grbl_rig, ur_rig
from campaign.scanning import Resumed, Scan, adopt_orphans, start
from campaign.serve import open_line, serve
from campaign.stored import complete_bytes

HANG_S = 40.0  # a scan that takes longer hangs; undisturbed it takes about 8 s
AFTER_S = 0.5
KILLED = 128 + signal.SIGKILL
AFTER_KILL_S = 4.0  # guards alone bring it to rest: a board that answers late in 2.1 s
DISK_BYTES = 3_000_000


@dataclass(frozen=True)
class Ended:
    """How the scan's process ended and what it said; ``status`` is None if it had to be killed."""

    status: int | None
    seconds: float
    answer: dict[str, Any] | None
    said: str
    run: Path | None
    second: int | None
    resumed: Resumed | None


def beside(jobs: int) -> ProcessPoolExecutor:
    """Runs beside each other: forks that have imported everything, and may have children."""
    return ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("fork"))


@contextmanager
def struck_once(draw: Draw) -> Iterator[tuple[Path, Ended]]:
    """Run it on the wall clock; within, the folder holds ``truth.npz`` and what was stored."""
    adopt_orphans()
    folder = Path(mkdtemp(prefix="palpate-campaign-"))
    out = folder / "out"
    out.mkdir()
    small = "no space" in draw.name and _mount(out)
    rig = folder / "rig.toml"
    truth, commands = _start_truth(draw, rig, folder)
    host: Host | None = None
    try:
        arguments = ["scan", str(rig), "--out", str(out), "--json"]
        scan = start(arguments, folder, folder / "answer.json")
        host = Host(scan, out, rig)
        yield folder, _follow(draw, host, commands, folder)
    finally:
        if host is not None:
            host.close()
            _end(host.scan)
        with suppress(OSError):
            os.close(commands)
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(truth, signal.SIGKILL)
            os.waitpid(truth, 0)
        if small:
            subprocess.run(["umount", str(out)], check=False)
        shutil.rmtree(folder, ignore_errors=True)


def _start_truth(draw: Draw, rig: Path, folder: Path) -> tuple[int, int]:
    """The process of the truth, and our end of a pipe both ways; writes the rig file."""
    if draw.arm:
        pid = os.getpid()
        host = f"127.77.{pid >> 8 & 255}.{pid & 255}"
        rig.write_text(ur_rig(host), encoding="utf-8")
        started = _fork(lambda commands: serve_arm(draw, host, commands, folder))
        _await_file(folder / "ready")
        return started
    board, cell = open_line(serial=draw.serial), open_line(serial=draw.serial)
    rig.write_text(grbl_rig(board.address, cell.address), encoding="utf-8")
    started = _fork(lambda commands: serve(draw, board, cell, commands, folder))
    board.close()
    cell.close()
    return started


def _fork(work: Callable[[int], None]) -> tuple[int, int]:
    ours, theirs = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        try:
            ours.close()
            work(theirs.fileno())
            os._exit(0)
        except BaseException:  # noqa: BLE001 - a fork must never go on as its parent
            traceback.print_exc()
            os._exit(1)
    theirs.close()
    return pid, ours.detach()


def _follow(draw: Draw, host: Host, commands: int, folder: Path) -> Ended:
    began_s, status, beside = time.monotonic(), None, False
    while status is None and time.monotonic() - began_s < HANG_S:
        terminal = host.scan.terminal
        watched = [commands] + ([terminal] if terminal is not None else [])
        ready, _, _ = select.select(watched, [], [], 0.01)
        if commands in ready:
            for number in os.read(commands, 16):
                host.strike(draw.faults[number])
        if terminal in ready:
            host.scan.drain()
        host.due()
        beside = beside or host.both_drive
        status = host.scan.status()
    seconds = time.monotonic() - began_s
    _end(host.scan)
    second = None
    if host.second is not None:
        second = _wait(host.second) if beside else None
        _end(host.second)
    _linger(AFTER_KILL_S if status in (None, KILLED) else AFTER_S, host)
    resumed = _resume(host, folder) if status == KILLED and len(draw.faults) == 1 else None
    host.scan.drain()
    with socket.socket(fileno=os.dup(commands)) as ours:
        ours.shutdown(socket.SHUT_WR)
    _await_file(folder / "truth.npz")
    said = host.scan.said.decode("utf-8", "replace").replace("\r\n", "\n")
    return Ended(status, seconds, _answer(folder / "answer.json"), said, host.run_file, second,
                 resumed)  # fmt: skip


def _resume(host: Host, folder: Path) -> Resumed | None:
    """Go on with a killed run on the same rig, the probe still where the kill left it."""
    run = host.run_file
    if run is None or run.stat().st_size == 0:
        return None
    before = complete_bytes(run)
    scan = start(["resume", str(run), "--json"], folder, folder / "resumed.json")
    status = _wait(scan)
    _end(scan)
    _linger(AFTER_S, host)
    after = complete_bytes(run)
    kept = all(after.get(station) == stored for station, stored in before.items())
    return Resumed(status, scan.said.decode("utf-8", "replace").replace("\r\n", "\n"), kept)


def _linger(seconds: float, host: Host) -> None:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        time.sleep(0.02)
        host.due()


def _wait(scan: Scan) -> int | None:
    until_s = time.monotonic() + HANG_S
    while (status := scan.status()) is None and time.monotonic() < until_s:
        scan.drain()
        time.sleep(0.02)
    return status


def _end(scan: Scan) -> None:
    """Nothing of it stays; only processes of this scan's own group are ended."""
    for pid in (scan.pid, scan.leader):
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(pid, signal.SIGKILL) if pid == scan.pid else os.kill(pid, signal.SIGKILL)
    for pid in (scan.pid, scan.leader):
        with suppress(ChildProcessError):
            os.waitpid(pid, 0)
    scan.drain()


def _await_file(path: Path) -> None:
    until_s = time.monotonic() + 20.0
    while not path.exists() and time.monotonic() < until_s:
        time.sleep(0.01)


def _answer(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _mount(folder: Path) -> bool:
    """A disk so small that it can be filled; needs root, without it the kind strikes nothing."""
    command = ["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(folder)]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0
