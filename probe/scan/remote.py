"""Asking a running scan from another process to pause, resume, abort or stop.

The scan listens on a loopback port and leaves port and secret in ``RUN.control`` beside the run
file, readable by its owner only. One line of JSON each way. Only the four words below exist: a
peer with the secret can halt or lift the probe and let a paused scan go on, but not choose where
it goes.
"""

import errno
import json
import os
import secrets
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from probe.guards.commands import Control

WORDS = ("pause", "resume", "abort", "stop")
TIMEOUT_S = 1.0
LINE_BYTES = 400
LOOK_S = 0.02
MOST_OPEN = 64


class NotRunning(RuntimeError):
    """No scan answers for this run: the text says what to do."""


def control_path(run_path: Path) -> Path:
    """Where a running scan says how to reach it."""
    run_path = run_path.resolve()  # beside the file itself, also if asked through a link
    return run_path.with_name(run_path.name + ".control")


@contextmanager
def listening(control: Control, run_path: Path) -> Iterator[None]:
    """Within: `ask` reaches ``control``, from any process of the same user on this machine."""
    token = secrets.token_hex(16)
    path, end = control_path(run_path), threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        answer = partial(_obey, control, token)
        thread = threading.Thread(target=_serve, args=(listener, end, answer), daemon=True)
        thread.start()
        path.unlink(missing_ok=True)
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w") as file:
            json.dump({"port": listener.getsockname()[1], "token": token}, file)
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
            end.set()
            thread.join()


def _serve(listener: socket.socket, end: threading.Event, answer: Callable[[bytes], str]) -> None:
    """One thread for all, however many connect: who says nothing gives way to who comes later.

    A descriptor is kept for whoever asks when the scan has none left.
    """
    listener.setblocking(False)
    open_s: dict[socket.socket, float] = {}
    heard: dict[socket.socket, bytes] = {}
    spare: socket.socket | None = None
    while not end.is_set():
        ready = select.select([listener, *open_s], [], [], LOOK_S)[0]
        if spare is None and not (ready or open_s):
            with suppress(OSError):
                spare = listener.dup()
        for peer in ready:
            if peer is listener:
                try:
                    new, _ = listener.accept()
                except OSError as error:  # gone again, or no descriptors left
                    if error.errno == errno.EMFILE and spare is not None:
                        spare.close()
                        spare = None
                    else:
                        end.wait(LOOK_S)
                    continue
                new.setblocking(False)
                open_s[new], heard[new] = time.monotonic(), b""
                continue
            try:
                data = peer.recv(LINE_BYTES)
                heard[peer] += data
                if b"\n" not in heard[peer] and data and len(heard[peer]) < LINE_BYTES:
                    continue
                peer.sendall(answer(heard[peer].partition(b"\n")[0]).encode() + b"\n")
            except OSError:  # the asker went away; nothing was asked
                pass
            _hang_up(peer, open_s, heard)
        late_s = time.monotonic() - TIMEOUT_S
        for peer in [p for n, p in enumerate(open_s)
                     if open_s[p] < late_s or n < len(open_s) - MOST_OPEN]:  # fmt: skip
            _hang_up(peer, open_s, heard)
    for peer in list(open_s):
        _hang_up(peer, open_s, heard)
    if spare is not None:
        spare.close()


def _hang_up(
    peer: socket.socket, open_s: dict[socket.socket, float], heard: dict[socket.socket, bytes]
) -> None:
    open_s.pop(peer, None)
    heard.pop(peer, None)
    peer.close()


def ask(run_path: Path, word: str) -> None:
    """Send one of `WORDS` to the scan that writes ``run_path``; returns once it has heard.

    Raises `NotRunning` if no scan answers, `ValueError` for another word.
    """
    if word not in WORDS:
        raise ValueError(f"{word!r}: the scan understands {', '.join(WORDS)}")
    try:
        where = json.loads(control_path(run_path).read_text())
        with socket.create_connection(("127.0.0.1", where["port"]), TIMEOUT_S) as peer:
            peer.sendall(json.dumps({"token": where["token"], "word": word}).encode() + b"\n")
            answer = peer.makefile().readline(LINE_BYTES).strip()
    except FileNotFoundError:
        raise NotRunning(
            f"{run_path}: no scan on this machine is writing it; use the rig's own stop"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise NotRunning(
            f"{run_path}: the scan does not answer ({error}); use the rig's own stop"
        ) from None
    if answer != "ok":
        raise NotRunning(f"{run_path}: the scan refused {word}: {answer or 'no answer'}")


def _obey(control: Control, token: str, line: bytes) -> str:
    try:
        message = json.loads(line)
        known = secrets.compare_digest(str(message["token"]), token)
        word = message["word"]
    except (ValueError, KeyError, TypeError):
        return "not understood"
    if not known:
        return "wrong token"
    if word not in WORDS:
        return "unknown word"
    {
        "pause": control.pause,
        "resume": control.resume,
        "abort": control.abort,
        "stop": control.stop,
    }[word]()
    return "ok"
