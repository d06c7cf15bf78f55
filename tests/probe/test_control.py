import os
import signal

import pytest

from probe.control import Control, Wish, ctrl_c


def test_the_most_urgent_wish_wins_and_an_abort_stays() -> None:
    control = Control()
    assert control.wish is Wish.GO_ON
    control.pause()
    control.pause(now=True)
    assert control.wish is Wish.PAUSE_NOW
    control.abort()
    control.resume()
    assert control.wish is Wish.ABORT
    control.stop()
    assert control.wish is Wish.STOP


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_aborts_and_a_second_stops(number: signal.Signals) -> None:
    control, before = Control(), signal.getsignal(number)
    with ctrl_c(control):
        os.kill(os.getpid(), number)
        assert control.wish is Wish.ABORT
        for _ in range(50):
            os.kill(os.getpid(), number)
        assert control.wish is Wish.STOP
    assert signal.getsignal(number) is before
