"""Shared by all tests: what is imported first, tissue that needs no finite elements, and Qt."""

import gc
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from drivers.core.arrays import Array
from drivers.core.errors import MissingExtra
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray

settings.register_profile("busy machine", deadline=None)
settings.load_profile("busy machine")

ROOT = Path(__file__).parents[1]
WINDOWS = ROOT / "tests" / "probe" / "gui"


def import_all() -> None:
    """All modules, before a test replaces a function that one of them would keep. Windows come
    last: Qt looks into the source of all that is imported after it, for 2 of 6 s."""
    packages = ("calibration", "drivers", "palpate", "probe", "sim_backend")
    files = (file for package in packages for file in (ROOT / package).rglob("*.py"))
    for file in sorted(files, key=lambda file: (WINDOWS.name in file.parts, file)):
        module = file.relative_to(ROOT).with_suffix("")
        if module.name != "__main__":
            with suppress(ImportError, MissingExtra):  # of what is not installed here
                import_module(".".join(module.parts).removesuffix(".__init__"))


import_all()

try:
    from PySide6 import QtWidgets as _QtWidgets  # noqa: F401 - is it there?

    WHY_NO_QT = None
except ImportError as missing:  # Qt's wheels leave libEGL and others to the system
    WHY_NO_QT = f"Qt does not start ({missing}); `make test` as root installs what it needs"


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell that starts the tests in the background has Ctrl-C ignored, and children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Without Qt the windows' tests cannot even be imported."""
    return True if WHY_NO_QT and collection_path == WINDOWS else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, as a whole, so that what a file's tests share is made once."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


def pytest_collection_finish() -> None:
    """What is imported stays, so that no collection looks through it: that takes 0.3 s, in which
    nobody has the interpreter, guards of a scan neither."""
    gc.collect()
    gc.freeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say what was not tested."""
    if WHY_NO_QT:
        terminalreporter.write_line(f"SKIPPED {WINDOWS}: {WHY_NO_QT}", yellow=True)


@dataclass(frozen=True)
class Winkler:
    """A bed of springs with a vessel that passes part of its pressure on.

    F = k d + A p d / 2.5 mm, with k stiffer over an inclusion at 32 mm.
    """

    stiffness_n_m: float
    area_m2: float
    array: TaxelArray | None = None

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        depth = np.maximum(depth_m, 0.0)
        return self.stiffness_n_m * depth + self.area_m2 * pressure_pa * depth / 2.5e-3

    def von_mises_pa(self, depth_m: Array, pressure_pa: Array) -> Array:
        return self.force_n(depth_m, pressure_pa) / 1e-4

    def shares(self, depth_m: Array, _pressure_pa: Array) -> Array:
        """More to the right in each row."""
        row = np.arange(1.0, self.array.columns + 1)
        one = np.tile(row / (row.sum() * self.array.rows), (self.array.rows, 1))
        return np.broadcast_to(one, (*np.shape(depth_m), *one.shape))


def respond_winkler(
    scene: Scene, x_m: float, _max_depth_m: float, array: TaxelArray | None = None
) -> Winkler:
    near = np.exp(-(((x_m - 0.032) / 0.006) ** 2)) if scene.inclusion else 0.0
    return Winkler(400.0 * (1 + 0.2 * near), 2e-6 * near if scene.arteries else 0.0, array)


@pytest.fixture(scope="session")
def winkler() -> Callable[[Scene, float, float], Winkler]:
    """A quick stand-in for `sim_backend.models.station_response.respond`."""
    return respond_winkler
