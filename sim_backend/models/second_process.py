"""Independent solves shared with a second process.

It takes them in order, from the one on that was asked for first. While it is at the one that is
asked for here, the last ones are solved here: both meet. Each says what it begins with: at worst
one task is done twice, and both answers are the same to the last bit. The other process is a fresh
interpreter and no fork: where it is started there may be windows, guards and drivers with threads.
"""

import atexit
import os
import signal
import subprocess
from collections.abc import Callable, Sequence, Set
from contextlib import suppress
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from threading import Condition, Thread
from typing import Any, Generic, TypeVar

from drivers.core.child import Child, interpreter, no_ctrl_c

END_S = 5.0
BEGUN, FAILED, SOLVED = "begun", "failed", "solved"
Answer = TypeVar("Answer")


class SecondProcess(Generic[Answer]):
    """Answers of ``function(*task)``, a module's function, for some of ``tasks``.

    No process is started for fewer than two of them, on a single processor, or in a worker of a
    pool, which has its share of the processors already. `close` ends it.
    """

    def __init__(self, function: Callable[..., Answer], tasks: Sequence[tuple[Any, ...]]) -> None:
        self._function, self._tasks = function, list(tasks)
        self._theirs: set[int] = set()  # begun by the other process
        self._ours: set[int] = set()  # begun by this one
        self._solved: dict[int, Answer] = {}
        self._failed: set[int] = set()
        self._child: Child | None = None
        self._news = Condition()
        self._ended = len(tasks) < 2 or processors() < 2 or parent_process() is not None
        self._thread = Thread(target=self._learn, name="palpate second process", daemon=True)
        if not self._ended:
            self._thread.start()

    def answer(self, number: int) -> Answer | None:
        """That of a task; None if it is the caller's to find: nobody else does, or it could not be
        found elsewhere."""
        with self._news:
            while not self._settled(number):
                if number not in self._theirs:
                    self._begin(number)
                    break
                last = self._last_left()
                if last is None:
                    self._news.wait_for(lambda: self._settled(number))
                else:
                    self._help(last)
            return self._solved.get(number)

    def _settled(self, number: int) -> bool:
        return self._ended or number in self._solved or number in self._failed

    def _last_left(self) -> int | None:
        begun = self._theirs | self._ours
        return next((n for n in reversed(range(len(self._tasks))) if n not in begun), None)

    def _help(self, number: int) -> None:
        """Solve a task here that is asked for later."""
        self._begin(number)
        self._news.release()
        try:
            with suppress(Exception):  # whatever it is, it is met again where it is asked for
                self._solved[number] = self._function(*self._tasks[number])
        finally:
            self._news.acquire()

    def _begin(self, number: int) -> None:
        self._ours.add(number)
        self._say({number})

    def close(self) -> None:
        """End the process, whatever it is doing. One that is still starting ends by itself."""
        with self._news:
            self._ended = True
            there = self._child is not None and self._child.alive()
            if self._child is not None and there:
                os.kill(self._child.pid, signal.SIGTERM)
        if there:
            self._thread.join(END_S)

    def _say(self, begun: set[int]) -> None:
        if self._child is not None:
            with suppress(OSError):  # it has just ended
                self._child.pipes[0].send(begun)

    def _learn(self) -> None:
        """Body of the thread: start the process, take what it has solved, and wait for its end."""
        early = _started_early.pop() if _started_early else None
        if early is not None and early.poll() is not None:  # somebody ended it
            early.communicate()  # closes what led to it
            early = None
        with no_ctrl_c():  # it is for the scan, which lifts the tip
            work = self._function, self._tasks
            child = Child(solve_in_turn, work, pipes=1, process=early)
        with self._news:
            self._child = child
            self._say(self._ours)
        with suppress(EOFError, OSError):
            while not self._ended:
                number, what, answer = child.pipes[0].recv()
                with self._news:
                    if what == BEGUN:
                        self._theirs.add(number)
                    elif (
                        what == FAILED
                    ):  # who asks for it gets the reason, where it is solved again
                        self._failed.add(number)
                    else:
                        self._solved[number] = answer
                    self._news.notify_all()
        with self._news:
            self._ended = True
            self._child = None
            self._news.notify_all()
        child.end(END_S)


_started_early: list["subprocess.Popen[bytes]"] = []


def start_early(module: str) -> None:
    """Start the interpreter of the next `SecondProcess` now, so that it imports ``module``, and
    what that needs, while this one still imports what comes before. None on a single processor."""
    if not _started_early and processors() > 1:
        with no_ctrl_c():
            _started_early.append(interpreter(module))
        atexit.register(_end_unused)


def _end_unused() -> None:
    """It would end by itself, and Python would say that nobody waited for it."""
    for process in _started_early:
        process.kill()
        process.communicate()


def solve_in_turn(
    function: Callable[..., Any], tasks: list[tuple[Any, ...]], pipe: "Connection[Any, Any]"
) -> None:
    """Body of the process: what is begun elsewhere comes in, at first all that was before it was
    there, beginnings and answers go out.

    It ends with the process at the other end, however that ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be blocked
    _wait_like_others()
    try:
        theirs: set[int] = set(pipe.recv())  # begun at the other end
    except (EOFError, OSError):
        return
    ours: set[int] = set()

    def listen() -> None:
        try:
            while True:
                theirs.update(pipe.recv())
        except (EOFError, OSError):
            os._exit(0)

    Thread(target=listen, daemon=True).start()
    with suppress(OSError):  # nobody listens any more
        while (number := next_task(len(tasks), ours, frozenset(theirs))) is not None:
            ours.add(number)
            pipe.send((number, BEGUN, None))
            try:
                pipe.send((number, SOLVED, function(*tasks[number])))
            except Exception:  # noqa: BLE001 - whatever it is, it is met again where it is asked for
                pipe.send((number, FAILED, None))


def next_task(count: int, ours: Set[int], theirs: Set[int]) -> int | None:
    """The first that nobody has begun after the first of ``theirs``, since what lies before that
    may never be asked for; if there is none, the first that nobody has begun."""
    left = [n for n in range(count) if n not in ours and n not in theirs]
    first = min(theirs, default=-1)
    return next((n for n in left if n > first), left[0] if left else None)


def _wait_like_others() -> None:
    """Give up what precedence a process of guards has, which would be this one's too."""
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), 0))


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
