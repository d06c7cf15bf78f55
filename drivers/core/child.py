"""A function in a process of its own, with pipes to it.

Not `multiprocessing.Process`: a spawned one runs the caller's script again to find the function,
so that a script without an ``if __name__ == "__main__"`` guard would start itself over and over.
This one imports the function's module and nothing of the caller's.
"""

import gc
import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from multiprocessing.connection import Client, Connection, Listener
from subprocess import PIPE
from typing import Any

BOOTSTRAP = """
import gc, pickle, sys
try:
    sys.path[:], thresholds = pickle.load(sys.stdin.buffer)
    gc.set_threshold(*thresholds)
    order = pickle.load(sys.stdin.buffer)
except EOFError:  # who started it has ended meanwhile: there is nobody to tell
    sys.exit(1)
from drivers.core.child import run
run(*order)
"""
KEY_BYTES = 32


@contextmanager
def no_ctrl_c() -> Iterator[None]:
    """Within, Ctrl-C asks neither this thread to end nor, from its first instruction on, a process
    that is started here; one that came meanwhile is raised at the end. Windows has no such mask.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Child:
    """``function(*arguments, *pipes)``, running elsewhere; ``pipes`` are this side's ends.

    ``function`` is a module's; ``arguments`` can be pickled. It looks for garbage as often as this
    process. The pipes of a side that has ended raise `EOFError` or `OSError` on the other.
    """

    def __init__(
        self, function: Callable[..., None], arguments: tuple[Any, ...], pipes: int
    ) -> None:
        key = os.urandom(KEY_BYTES)
        where = (function.__module__, function.__name__)
        with Listener(authkey=key) as listener:
            order = listener.address, key, pipes, *where, arguments
            self._process = subprocess.Popen([sys.executable, "-c", BOOTSTRAP], stdin=PIPE)
            try:
                assert self._process.stdin is not None
                with self._process.stdin as stdin:
                    for part in ((sys.path, gc.get_threshold()), order):  # found by that path
                        stdin.write(pickle.dumps(part))
                self.pipes = [listener.accept() for _ in range(pipes)]
            except BaseException:  # nobody will hold it, to end it later
                self._process.kill()
                self._process.wait()
                raise

    @property
    def pid(self) -> int:
        return self._process.pid

    def alive(self) -> bool:
        """True until it has ended."""
        return self._process.poll() is None

    def end(self, timeout_s: float) -> None:
        """Nothing goes through the pipes any more; kill it if it does not end by itself within
        ``timeout_s``. Who still reads them, in another thread too, gets `EOFError`."""
        for pipe in self.pipes:
            with suppress(OSError), socket.socket(fileno=os.dup(pipe.fileno())) as line:
                line.shutdown(socket.SHUT_RDWR)  # a pipe closed under its reader has no end
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def run(
    address: Any, key: bytes, pipes: int, module: str, name: str, arguments: tuple[Any, ...]
) -> None:
    """The other side."""
    try:
        ends: list[Connection[Any, Any]] = [Client(address, authkey=key) for _ in range(pipes)]
    except (OSError, EOFError):  # who started it ended meanwhile: there is nobody to tell
        sys.exit(1)
    function = getattr(import_module(module), name)
    gc.freeze()  # what was imported is no garbage, and to look through it takes 20 ms
    function(*arguments, *ends)
