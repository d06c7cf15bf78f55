import os
import signal
from collections.abc import Iterator

import pytest

from probe.guards.commands import Control, RunCommand, ctrl_c


@pytest.fixture(autouse=True)
def hangup_heard() -> Iterator[None]:
    """As at a terminal, also where whoever runs the tests has hangups ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def test_the_most_urgent_command_wins_and_an_abort_stays() -> None:
    control = Control()
    assert control.command is RunCommand.RESUME
    control.pause()
    control.pause(now=True)
    assert control.command is RunCommand.PAUSE_NOW
    control.abort()
    control.resume()
    assert control.command is RunCommand.ABORT
    control.stop()
    assert control.command is RunCommand.STOP


OTHERS = [signal.SIGTERM, signal.SIGQUIT, signal.SIGTSTP, signal.SIGHUP]


@pytest.mark.parametrize("number", [signal.SIGINT, *OTHERS])
def test_any_signal_aborts_and_ctrl_c_after_it_stops(number: signal.Signals) -> None:
    control, before = Control(), signal.getsignal(number)
    with ctrl_c(control):
        os.kill(os.getpid(), number)
        assert control.command is RunCommand.ABORT
        for _ in range(50):
            os.kill(os.getpid(), signal.SIGINT)
        assert control.command is RunCommand.STOP
    assert signal.getsignal(number) is before


def test_a_hangup_that_nohup_had_ignored_stays_ignored() -> None:
    control, before = Control(), signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ctrl_c(control):
            os.kill(os.getpid(), signal.SIGHUP)
            assert control.command is RunCommand.RESUME
            os.kill(os.getpid(), signal.SIGTERM)
            assert control.command is RunCommand.ABORT
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", OTHERS)
def test_what_a_dying_terminal_and_a_shutdown_send_lifts_however_often(
    number: signal.Signals,
) -> None:
    control = Control()
    with ctrl_c(control):
        for sent in (signal.SIGTSTP, number, number, signal.SIGTERM):
            os.kill(os.getpid(), sent)
        assert control.command is RunCommand.ABORT
