"""Press a probe into soft tissue and learn what lies beneath: the public names, and nothing else.

import palpate
result = palpate.scan(scene="TIHA")           # or palpate.scan("rig.toml")
run = palpate.open_run(result.path)
run.stations(), run.samples()                 # a table; labelled arrays with units
palpate.detect(run)                           # what lies beneath, and where

Names are imported when they are first used: ``import palpate`` costs nothing.
"""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibration import Calibration, record, save
    from calibration.errors import CalibrationError
    from drivers import ConfigError, DeviceAbsent, DeviceFault, SimulatedClock, WallClock
    from probe.calibrate.fits import calibrate
    from probe.config.devices import connect
    from probe.config.load_rig import load_rig
    from probe.config.rig import Device, Rig, RigError, Safety, Scan, SceneChoice, default_rig
    from probe.config.scan_limits import limits_for
    from probe.config.scan_plan import plan_for
    from probe.core.errors import RunFileError
    from probe.core.recording import Recording, Station
    from probe.detection.compare import compare
    from probe.detection.finding import Comparison, Finding, ObjectFinding, StationFinding
    from probe.detection.scan import detect
    from probe.detection.twin import twin
    from probe.detection.unlike_empty import Unlike, unlike_empty
    from probe.guards.commands import Control
    from probe.report import write_report
    from probe.scan.engine import run_scan
    from probe.scan.resume import resume
    from probe.scan.session import ScanResult, scan
    from probe.storage.csv_import import Imported, import_csv
    from probe.storage.export import export
    from probe.storage.run import Run, follow, open_run
    from probe.storage.verify import Report, verify
    from probe.studies.sweep import sweep
    from sim_backend.models.press import CannotSolve, Press, press
    from sim_backend.scene.scene_file import Scene, SceneError, load_scene, scene_names
    from sim_backend.scene.taxels import TaxelArray
    from sim_backend.touch.touch import Touch, touch

__all__ = [
    "Calibration",
    "CalibrationError",
    "CannotSolve",
    "Comparison",
    "ConfigError",
    "Control",
    "Device",
    "DeviceAbsent",
    "DeviceFault",
    "Finding",
    "Imported",
    "ObjectFinding",
    "Press",
    "Recording",
    "Report",
    "Rig",
    "RigError",
    "Run",
    "RunFileError",
    "Safety",
    "Scan",
    "ScanResult",
    "Scene",
    "SceneChoice",
    "SceneError",
    "SimulatedClock",
    "Station",
    "StationFinding",
    "TaxelArray",
    "Touch",
    "Unlike",
    "WallClock",
    "calibrate",
    "compare",
    "connect",
    "default_rig",
    "detect",
    "export",
    "follow",
    "import_csv",
    "limits_for",
    "load_rig",
    "load_scene",
    "open_run",
    "plan_for",
    "press",
    "record",
    "resume",
    "run_scan",
    "save",
    "scan",
    "scene_names",
    "sweep",
    "touch",
    "twin",
    "unlike_empty",
    "verify",
    "write_report",
]

_HOMES = {
    "calibration": ("Calibration", "record", "save"),
    "calibration.errors": ("CalibrationError",),
    "drivers": ("ConfigError", "DeviceAbsent", "DeviceFault", "SimulatedClock", "WallClock"),
    "probe.guards.commands": ("Control",),
    "probe.scan.engine": ("run_scan",),
    "probe.scan.resume": ("resume",),
    "probe.scan.session": ("ScanResult", "scan"),
    "probe.calibrate.fits": ("calibrate",),
    "probe.config.devices": ("connect",),
    "probe.config.rig": (
        "Device",
        "Rig",
        "RigError",
        "Safety",
        "Scan",
        "SceneChoice",
        "default_rig",
    ),
    "probe.config.load_rig": ("load_rig",),
    "probe.config.scan_limits": ("limits_for",),
    "probe.config.scan_plan": ("plan_for",),
    "probe.core.errors": ("RunFileError",),
    "probe.core.recording": ("Recording", "Station"),
    "probe.detection.compare": ("compare",),
    "probe.detection.finding": ("Comparison", "Finding", "ObjectFinding", "StationFinding"),
    "probe.detection.scan": ("detect",),
    "probe.detection.twin": ("twin",),
    "probe.detection.unlike_empty": ("Unlike", "unlike_empty"),
    "probe.report": ("write_report",),
    "probe.storage.csv_import": ("Imported", "import_csv"),
    "probe.storage.export": ("export",),
    "probe.storage.run": ("Run", "follow", "open_run"),
    "probe.storage.verify": ("Report", "verify"),
    "probe.studies.sweep": ("sweep",),
    "sim_backend.models.press": ("CannotSolve", "Press", "press"),
    "sim_backend.scene.scene_file": ("Scene", "SceneError", "load_scene", "scene_names"),
    "sim_backend.scene.taxels": ("TaxelArray",),
    "sim_backend.touch.touch": ("Touch", "touch"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def _check_hidden() -> None:
    """Say which folder hides one of the four packages, which live beside this one."""
    home = Path(__file__).resolve().parent.parent
    for package in ("probe", "drivers", "sim_backend", "calibration"):
        spec = find_spec(package)
        places = [] if spec is None else [Path(p) for p in spec.submodule_search_locations or ()]
        found = places[0] if places else Path(spec.origin or "") if spec else None
        if found is not None and found.resolve() != home / package:
            raise ImportError(
                f"{found} hides palpate's own package {package!r}; rename it, or run Python "
                "from another folder"
            )


_check_hidden()


if not TYPE_CHECKING:  # a type checker sees the names above, and refuses every other

    def __getattr__(name: str) -> Any:
        if name not in _HOME:
            raise AttributeError(f"module 'palpate' has no attribute {name!r}")
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return list(__all__)
