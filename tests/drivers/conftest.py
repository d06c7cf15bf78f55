"""What tests of drivers share: a clock, and a phantom of springs that hangs over the artery."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers import WallClock
from sim_backend import load_scene
from sim_backend.emulators import grbl
from sim_backend.emulators.serving import Served
from sim_backend.phantom.phantom import Phantom, Respond


@pytest.fixture
def clock() -> WallClock:
    return WallClock()


@pytest.fixture
def home() -> tuple[float, float, float]:
    """Where the tip is at first [m]; a file may have it elsewhere."""
    return (0.032, 0.0, 0.002)


@pytest.fixture
def phantom(clock: WallClock, winkler: Respond, home: tuple[float, float, float]) -> Phantom:
    return Phantom(load_scene("TIHA"), clock, winkler, home=home)


@pytest.fixture
def board(phantom: Phantom, tmp_path: Path) -> Iterator[Served]:
    """A homed GRBL board."""
    with grbl.emulate(phantom, at=str(tmp_path / "tty"), homed=True) as served:
        yield served
