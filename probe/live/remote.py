"""Asking a running scan from another process to pause, resume, abort or stop.

The scan listens on a loopback port and leaves port and secret in ``RUN.control`` beside the run
file, readable by its owner only. One line of JSON each way. Only the four words below exist, so
the worst a peer with the secret can do is halt the probe.
"""

import json
import os
import secrets
import socket
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from probe.control import Control

WORDS = ("pause", "resume", "abort", "stop")
TIMEOUT_S = 1.0
LINE_BYTES = 400


class NotRunning(RuntimeError):
    """No scan answers for this run: the text says what to do."""


def control_path(run_path: Path) -> Path:
    """Where a running scan says how to reach it."""
    return run_path.with_name(run_path.name + ".control")


@contextmanager
def listening(control: Control, run_path: Path) -> Iterator[None]:
    """Within: `ask` reaches ``control``, from any process of the same user on this machine."""
    token = secrets.token_hex(16)

    class Handler(socketserver.StreamRequestHandler):
        timeout = TIMEOUT_S

        def handle(self) -> None:
            with suppress(OSError):  # the asker went away; nothing was asked
                line = self.rfile.readline(LINE_BYTES)
                self.wfile.write(_obey(control, token, line).encode() + b"\n")

    class Server(socketserver.ThreadingTCPServer):
        daemon_threads = True

    path = control_path(run_path)
    with Server(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        path.unlink(missing_ok=True)
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w") as file:
            json.dump({"port": server.server_address[1], "token": token}, file)
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
            server.shutdown()


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
