"""What a user does: plan, scan, store, detect, show.

import probe
scanned = probe.scan(scene="TIHA")            # or probe.scan("rig.toml")
run = probe.open_run(scanned.path)
run.stations(), run.samples()                 # a table; labelled arrays with units
probe.detect(run.recording())                 # what lies beneath, and where

Names are imported when they are first used: ``import probe`` costs nothing.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from probe.detect import Comparison, Finding, compare, detect
    from probe.devices import connect
    from probe.engine import run_scan
    from probe.recording import Recording, Station
    from probe.report import write_report
    from probe.rig import Rig, default_rig, load_rig
    from probe.run import Run, follow, open_run
    from probe.session import Scanned, scan
    from sim_backend.press import press
    from sim_backend.scene import Scene, load_scene, scene_names

__all__ = [
    "Comparison",
    "Finding",
    "Recording",
    "Rig",
    "Run",
    "Scanned",
    "Scene",
    "Station",
    "compare",
    "connect",
    "default_rig",
    "detect",
    "follow",
    "load_rig",
    "load_scene",
    "open_run",
    "press",
    "run_scan",
    "scan",
    "scene_names",
    "write_report",
]

_HOMES = {
    "probe.detect": ("Comparison", "Finding", "compare", "detect"),
    "probe.devices": ("connect",),
    "probe.engine": ("run_scan",),
    "probe.recording": ("Recording", "Station"),
    "probe.report": ("write_report",),
    "probe.rig": ("Rig", "default_rig", "load_rig"),
    "probe.run": ("Run", "follow", "open_run"),
    "probe.session": ("Scanned", "scan"),
    "sim_backend.press": ("press",),
    "sim_backend.scene": ("Scene", "load_scene", "scene_names"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'probe' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Flat(ModuleType):
    """Importing the package ``probe.detect`` must not hide the function ``probe.detect``."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Flat
