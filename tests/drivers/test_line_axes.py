"""Axes of Zaber, PI and TMCL, each exchange on a line that damages, delays or takes its time."""

from collections.abc import Iterator
from importlib import import_module
from itertools import islice
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import drivers.tmcl
import drivers.zaber
from drivers import SimulatedClock
from drivers.core.leading import Lead
from drivers.core.line import NoAnswer
from drivers.core.segments import AHEAD_S, SegmentedMove
from sim_backend import load_scene
from sim_backend.emulators import pi, tmcl, zaber
from sim_backend.emulators.carriage import Carriage
from sim_backend.phantom.phantom import Phantom, Respond

EMULATORS: dict[str, Any] = {"zaber": zaber, "pi": pi, "tmcl": tmcl}
HOME = (0.032, 0.0, 0.002)
PRESS_M_S = 1.2e-3


def device_in(phantom: Phantom, name: str) -> Any:
    """A controller of this make with the phantom's tip on its axes."""
    carriage = Carriage(phantom, homed=True)
    return {"zaber": lambda: zaber.ZaberChain(carriage, check_sums=True),
            "pi": lambda: pi.PiController(carriage, servo=True),
            "tmcl": lambda: tmcl.TmclModule(carriage)}[name]()  # fmt: skip


def axes_at(line: object, name: str, axes: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The driver's axes at a line that the test has made."""
    monkeypatch.setattr(f"drivers.{name}.Line", lambda *_: line)
    module = import_module(f"drivers.{name}")
    keys = {axis: EMULATORS[name].RIG_AXES[axis] for axis in axes}
    settings = getattr(module, f"{name.title()}Settings")(port="pty", **keys)
    return getattr(module, f"{name.title()}Axes")(settings)


def axes_on(
    phantom: Phantom, name: str, axis: str, exchange_s: float, monkeypatch: pytest.MonkeyPatch
) -> Any:
    """One axis on a line whose every exchange takes ``exchange_s`` of the world's time."""
    clock, device = phantom.clock, device_in(phantom, name)

    class Line:
        def ask(self, data: bytes, *, end: bytes = b"", **_how: Any) -> bytes:
            clock.sleep_until(clock.now() + exchange_s)
            answer = b"".join(device.received(bytes([byte])) for byte in data)
            return answer.removesuffix(end) if end else answer

        def say(self, data: bytes) -> None:
            device.received(data)

    for waits in ("drivers.tmcl.time", "drivers.core.leading.time"):
        monkeypatch.setattr(waits, SimpleNamespace(monotonic=clock.now))
    return axes_at(Line(), name, axis, monkeypatch)


def flipped(answer: bytes) -> Iterator[bytes]:
    for at in range(len(answer)):
        for bit in range(8):
            yield answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]


@pytest.mark.parametrize("name", ["zaber", "tmcl"])
def test_no_answer_with_a_flipped_bit_is_taken(
    name: str, phantom: Phantom, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each bit of each byte of a position: the sum that goes with it does not match."""
    device = device_in(phantom, name)
    asked: list[bytes] = []

    class Line:
        """A device that answers once, with the next damage."""

        def ask(self, data: bytes, **_how: Any) -> bytes:
            asked.append(data)
            return damage(device.received(data))

        def listen(self, **_how: Any) -> bytes:
            raise NoAnswer(name, "silent")

    axes = axes_at(Line(), name, "x", monkeypatch)

    def damage(answer: bytes) -> bytes:
        return answer.removesuffix(b"\r\n")

    good = axes.read().places_mm["x"]
    assert good == pytest.approx(52.0, abs=1e-3)
    for n in range(8 * len(damage(device.received(asked[-1])))):

        def damage(answer: bytes, n: int = n) -> bytes:
            return next(islice(flipped(answer.removesuffix(b"\r\n")), n, None))

        with pytest.raises(NoAnswer):
            axes.read()


def test_a_reply_that_comes_too_late_is_not_taken_for_the_next(
    phantom: Phantom, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = device_in(phantom, "zaber")
    late: list[bytes] = []

    class Line:
        """The reply to each question comes again, before that to the next."""

        def ask(self, data: bytes, **_how: Any) -> bytes:
            late.append(device.received(data).removesuffix(b"\r\n"))
            return late.pop(0) if len(late) > 1 else late[0]

        def listen(self, **_how: Any) -> bytes:
            return late[0]

    axes = axes_at(Line(), "zaber", "xz", monkeypatch)
    places_mm = axes.read().places_mm
    assert places_mm == pytest.approx({"x": 52.0, "z": places_mm["z"]}, abs=1e-3)
    assert axes.read().places_mm == places_mm


def test_a_motor_that_was_ordered_to_go_and_has_not_set_off_has_not_arrived(
    winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimulatedClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=HOME)
    device = device_in(phantom, "tmcl")

    class Line:
        """The module accepts a move a little before its motor turns."""

        def ask(self, data: bytes, **_how: Any) -> bytes:
            answer = device.received(data)
            if tuple(data[1:3]) == (drivers.tmcl.GAP, drivers.tmcl.SPEED):
                answer = answer[:4] + bytes(4)
                answer += bytes([sum(answer) % 256])
            return answer

    monkeypatch.setattr("drivers.tmcl.time", SimpleNamespace(monotonic=clock.now))
    axes = axes_at(Line(), "tmcl", "x", monkeypatch)
    axes.move({"x": 54.0}, {"x": 5.0})
    assert axes.read().moving
    clock.sleep_until(10.0)
    assert not axes.read().moving


@pytest.mark.parametrize("name", EMULATORS)
def test_what_is_reported_at_rest_was_read_at_rest(
    name: str, winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An axis that comes to rest between two exchanges of one reading, at 9600 baud."""
    phantom = Phantom(load_scene("TIHA"), SimulatedClock(), winkler, home=HOME)
    axes = axes_on(phantom, name, "x", 0.02, monkeypatch)
    for n in range(40):  # ends at ever other exchanges
        target_mm = 52.0 + (n % 2) * (1.0 + 0.09 * n)
        axes.move({"x": target_mm}, {"x": 40.0})
        while (reading := axes.read()).moving:
            pass
        assert reading.places_mm["x"] == pytest.approx(target_mm, abs=1e-3)


@pytest.mark.parametrize("exchange_s", [0.001, 0.004])
@pytest.mark.parametrize("name", EMULATORS)
def test_a_ramp_that_is_led_has_no_ripple(
    name: str, exchange_s: float, winkler: Respond, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The force as the emulator's side has it; an exchange takes what it does at 115200 or 38400
    baud, and between two readings there are 10 ms."""
    clock = SimulatedClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=(0.032, 0.0, 0.0))
    axes = axes_on(phantom, name, "z", exchange_s, monkeypatch)
    origin_mm = dict(zip("xyz", EMULATORS[name].RIG_ORIGIN_MM, strict=True))
    speed_mm_s = 1e3 * PRESS_M_S
    way = SegmentedMove((0.0,) * 3, (0.0, 0.0, -2.4), speed_mm_s, ahead_mm=AHEAD_S * speed_mm_s)
    lead = Lead(way, "z", origin_mm, 0.05)
    lead.set_off(axes)
    began_s = clock.now()
    while clock.now() < began_s + 2.5:
        lead.go_on(axes, axes.read(), None)
        clock.sleep_until(clock.now() + 0.01)
    assert not lead.trouble
    assert phantom.tip.point(clock.now())[2] == pytest.approx(-2.4e-3, abs=1e-6)
    times = began_s + np.arange(0.01, 1.98, 1e-3)
    force = phantom.force_n(times)
    even = np.interp(times, times[[0, -1]], force[[0, -1]])
    assert np.abs(force - even).max() < 2e-4 * force[-1]  # a speed is a whole number of steps
