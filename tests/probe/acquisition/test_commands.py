import os
import signal

import pytest

from probe.acquisition.commands import Control, RunCommand, ctrl_c


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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGTSTP])
def test_ctrl_c_aborts_and_a_second_stops(number: signal.Signals) -> None:
    control, before = Control(), signal.getsignal(number)
    with ctrl_c(control):
        os.kill(os.getpid(), number)
        assert control.command is RunCommand.ABORT
        for _ in range(50):
            os.kill(os.getpid(), number)
        assert control.command is RunCommand.STOP
    assert signal.getsignal(number) is before


def test_a_closed_terminal_aborts_however_often_it_is_told() -> None:
    control = Control()
    with ctrl_c(control):
        for _ in range(3):
            os.kill(os.getpid(), signal.SIGHUP)
        assert control.command is RunCommand.ABORT
