"""Asking a running scan from another process to pause, resume, abort or stop.

The scan listens on a datagram socket in a folder that only its user can enter, and leaves that
folder's name in ``RUN.control`` beside the run file. Only the four words below exist: who may write
there can halt or lift the probe and let a paused scan go on, but not choose where it goes.
"""

import secrets
import socket
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from probe.guards.commands import Control

WORDS = ("pause", "resume", "abort", "stop")
TIMEOUT_S = 1.0
LINE_BYTES = 400
LOOK_S = 0.02
DOOR = "scan"
LONGEST_FOLDER = 60  # characters: a socket's whole name has at most 104


class NotRunning(RuntimeError):
    """No scan answers for this run: the text says what to do."""


def control_path(run_path: Path) -> Path:
    """Where a running scan says how to reach it."""
    run_path = run_path.resolve()  # beside the file itself, also if asked through a link
    return run_path.with_name(run_path.name + ".control")


@contextmanager
def listening(control: Control, run_path: Path) -> Iterator[None]:
    """Within: `ask` reaches ``control``, from any process of the same user on this machine.

    Windows gives Python no such sockets: nobody is heard there.
    """
    if not hasattr(socket, "AF_UNIX"):
        yield
        return
    path, end = control_path(run_path), threading.Event()
    roomy = None if len(tempfile.gettempdir()) < LONGEST_FOLDER else "/tmp"
    folder = Path(tempfile.mkdtemp(prefix="palpate-", dir=roomy))  # of mode 0700
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as door:
            door.bind(str(folder / DOOR))
            door.settimeout(LOOK_S)
            thread = threading.Thread(target=_serve, args=(door, control, end), daemon=True)
            thread.start()
            path.unlink(missing_ok=True)
            path.write_text(str(folder), encoding="utf-8")
            try:
                yield
            finally:
                path.unlink(missing_ok=True)
                end.set()
                thread.join()
    finally:
        (folder / DOOR).unlink(missing_ok=True)
        with suppress(OSError):  # somebody is asking
            folder.rmdir()


def _serve(door: socket.socket, control: Control, end: threading.Event) -> None:
    while not end.is_set():
        with suppress(OSError):  # nobody has asked, or the asker went away
            said, asker = door.recvfrom(LINE_BYTES)
            word = said.decode("ascii", "replace")
            if word in WORDS:
                getattr(control, word)()
            if asker:  # else it has no name
                said = b"ok" if word in WORDS else b"unknown word"
                door.sendto(said, socket.MSG_DONTWAIT, asker)


def ask(run_path: Path, word: str) -> None:
    """Send one of `WORDS` to the scan that writes ``run_path``; returns once it has heard.

    Raises `NotRunning` if no scan answers, `ValueError` for another word.
    """
    if word not in WORDS:
        raise ValueError(f"{word!r}: the scan understands {', '.join(WORDS)}")
    try:
        folder = Path(control_path(run_path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise NotRunning(
            f"{run_path}: no scan on this machine is writing it; use the rig's own stop"
        ) from None
    own = folder / secrets.token_hex(8)
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
            line.settimeout(TIMEOUT_S)
            line.bind(str(own))
            line.sendto(word.encode(), str(folder / DOOR))
            answer = line.recv(LINE_BYTES).decode("ascii", "replace")
    except OSError as error:
        raise NotRunning(
            f"{run_path}: the scan does not answer ({error}); use the rig's own stop"
        ) from None
    finally:
        with suppress(OSError):
            own.unlink(missing_ok=True)
    if answer != "ok":
        raise NotRunning(f"{run_path}: the scan refused {word}: {answer or 'no answer'}")
