"""Work shared by two processes comes back in order, and a failure where it would be met alone."""

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from sim_backend.models import second_process
from sim_backend.models.second_process import (
    SecondProcess,
    next_task,
    solve_in_turn,
)


def all_answers(function: Callable[..., float], tasks: list[tuple[Any, ...]]) -> list[float]:
    """Of each task, in order, by whoever finds it."""
    other: SecondProcess[float] = SecondProcess(function, tasks)
    try:
        each = [other.answer(number) for number in range(len(tasks))]
    finally:
        other.close()
    pairs = zip(each, tasks, strict=True)
    return [function(*task) if answer is None else answer for answer, task in pairs]


@pytest.fixture(autouse=True)
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_process, "processors", lambda: 2)


def test_answers_come_in_the_order_of_their_tasks() -> None:
    tasks = [(3.0 * n, 4.0 * n) for n in range(50)]
    assert all_answers(math.hypot, tasks) == [5.0 * n for n in range(50)]
    assert all_answers(math.hypot, tasks[:1]) == [0.0]


def test_the_other_process_answers_in_order() -> None:
    other = SecondProcess(math.sqrt, [(float(n * n),) for n in range(4)])
    try:
        with other._news:
            other._news.wait_for(lambda: len(other._solved) == 4)
        assert list(other._solved) == [0, 1, 2, 3]
        assert other.answer(2) == 2.0
        assert not other._ours
    finally:
        other.close()


def test_what_was_begun_here_before_it_was_there_is_not_begun_there() -> None:
    other = SecondProcess(math.sqrt, [(float(n * n),) for n in range(4)])
    try:
        assert other.answer(0) is None  # the caller's to find
        with other._news:
            assert other._news.wait_for(lambda: len(other._solved) == 3, 60.0)
        assert other._theirs == {1, 2, 3}
    finally:
        other.close()


def test_while_it_is_busy_the_last_tasks_are_solved_here(tmp_path: Path) -> None:
    """Not to wait for a slow one, and not twice."""
    other = SecondProcess(waits_in_a_child, [(n, os.getpid(), tmp_path / "go") for n in range(5)])
    try:
        with other._news:
            other._news.wait_for(lambda: other._theirs == {0})
        assert other.answer(0) == 0  # and meanwhile
        assert list(other._solved) == [4, 3, 2, 1, 0]
        assert other._theirs == {0}
        assert [other.answer(n) for n in range(5)] == [0, 1, 4, 9, 16]
    finally:
        other.close()


def test_what_could_not_be_solved_meanwhile_is_met_where_it_is_asked_for(tmp_path: Path) -> None:
    numbers = (0, 1, -1)
    other = SecondProcess(waits_in_a_child, [(n, os.getpid(), tmp_path / "go") for n in numbers])
    try:
        with other._news:
            other._news.wait_for(lambda: other._theirs == {0})
        assert [other.answer(n) for n in range(3)] == [0, 1, None]
    finally:
        other.close()


def waits_in_a_child(number: int, parent: int, go: Path) -> int:
    """The square; elsewhere than in ``parent`` only after that has solved 1, and has had 0.2 s to
    be heard on a busy machine."""
    if number < 0:
        raise ValueError(number)
    if os.getpid() == parent and number == 1:
        threading.Event().wait(0.2)
        go.touch()
    while os.getpid() != parent and not go.exists():
        threading.Event().wait(0.01)
    return number * number


@pytest.mark.parametrize(
    ("ours", "theirs", "then"),
    [
        (set(), set(), 0),
        ({0}, set(), 1),
        ({0}, {4}, 1),  # the last ones are begun elsewhere
        ({0}, {2}, 3),  # a resumed scan, of which 0 and 1 were complete
        ({0, 3}, {2, 4}, 1),
        ({0, 1, 3}, {2, 4}, None),
    ],
)
def test_it_goes_on_from_what_was_asked_for_first(
    ours: set[int], theirs: set[int], then: int | None
) -> None:
    assert next_task(5, ours, theirs) == then


def test_a_failure_is_met_where_it_would_be_met_alone() -> None:
    with pytest.raises(ValueError, match=r"math domain|nonnegative"):
        all_answers(math.sqrt, [(4.0,), (1.0,), (-1.0,)])


def test_the_one_started_early_answers_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_process, "_started_early", [])
    second_process.start_early("math")
    second_process.start_early("math")  # one is enough
    (early,) = second_process._started_early
    tasks = [(float(n * n),) for n in range(4)]
    assert all_answers(math.sqrt, tasks) == [0.0, 1.0, 2.0, 3.0]
    assert not second_process._started_early
    assert early.wait(30) is not None


def test_one_started_early_that_somebody_ended_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_process, "_started_early", [])
    second_process.start_early("math")
    (early,) = second_process._started_early
    early.kill()
    early.wait()
    other = SecondProcess(math.sqrt, [(float(n * n),) for n in range(4)])
    try:
        with other._news:
            assert other._news.wait_for(lambda: len(other._solved) == 4, 60.0)
    finally:
        other.close()


def test_one_started_early_for_nothing_ends_with_its_starter() -> None:
    script = "from sim_backend.models import second_process as s; s.processors = lambda: 2; "
    script += "s.start_early('math'); print(s._started_early[0].pid)"
    command = [sys.executable, "-W", "always", "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert not done.stderr
    until_s = time.monotonic() + 30.0
    with suppress(ProcessLookupError):
        while time.monotonic() < until_s:
            os.kill(int(done.stdout), 0)
            time.sleep(0.01)
        pytest.fail("it still waits")


def test_what_starts_one_early_waits_for_no_numpy() -> None:
    """Nor for pydantic: the other interpreter would begin a tenth of a second later."""
    script = "import sys, sim_backend.models.second_process; "
    script += "print({'numpy', 'pydantic'} & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, check=True
    )
    assert done.stdout == "set()\n"


class NobodyListens:
    """A pipe of which the other end has just been closed."""

    asked = 0

    def __init__(self) -> None:
        self._came = iter([set[int]()])

    def recv(self) -> set[int]:
        for begun in self._came:
            return begun
        threading.Event().wait(1.0)  # what has ended is not noticed yet
        return {0}

    def send(self, _message: object) -> None:
        self.asked += 1
        raise BrokenPipeError


def test_it_ends_without_a_word_when_nobody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_process.signal, "signal", lambda *_: None)
    pipe = NobodyListens()
    solve_in_turn(math.sqrt, [(1.0,), (4.0,)], pipe)  # type: ignore[arg-type]
    assert pipe.asked == 1  # and the second task is not begun


@pytest.mark.skipif(not hasattr(os, "SCHED_RR"), reason="this system has no such scheduling")
def test_it_has_no_precedence_where_guards_have_it() -> None:
    found: list[int] = []

    def as_a_guard() -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
        except PermissionError:
            return
        other = SecondProcess(os.sched_getscheduler, [(0,), (0,)])
        try:
            with other._news:
                other._news.wait_for(lambda: len(other._solved) == 2)
            found.extend([*other._solved.values(), os.sched_getscheduler(0)])
        finally:
            other.close()

    guard = threading.Thread(target=as_a_guard)  # scheduling is a thread's
    guard.start()
    guard.join()
    if not found:
        pytest.skip("this user may not schedule by round robin")
    assert found == [os.SCHED_OTHER, os.SCHED_OTHER, os.SCHED_RR]


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no such signals here")
def test_ctrl_c_is_not_for_it() -> None:
    """Not even while it starts: it would end with a traceback, and be waited for."""
    other = SecondProcess(signal.pthread_sigmask, [(signal.SIG_BLOCK, ())] * 2)
    try:
        with other._news:
            other._news.wait_for(lambda: len(other._solved) == 2)
        assert signal.SIGINT in other._solved[0]
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    finally:
        other.close()
