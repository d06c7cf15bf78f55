"""What importing loads: a command or a scan begins at once, and a part stands without the rest."""

import pytest
from programs import python

WORK = ("numpy", "scipy", "pydantic", "drivers", "sim_backend")
HARDWARE = ("serial", "pymodbus", "libximc", "pynetft", "rtde_control", "rtde_receive")
HEAVY = ("PySide6", "pandas", "matplotlib", "xarray", "rtde_control", "serial", "pymodbus", "scipy")


@pytest.mark.parametrize("code, unloaded", [
    # numpy and pydantic take three times as long as all the rest of a command's help
    ("from probe.cli import main; main(['--help'])", WORK),
    ("import palpate", HEAVY),
    # scipy takes as long as all the rest, and a scan starts two or three processes
    ("import probe.guards.guard_process", ("scipy",)),
    ("import probe.scan.session", ("scipy",)),
    # a rig that scans and detects needs no simulation: scenes are what its file may name, and
    # the touch tables are what detection reads
    (
        "import probe.guards.guard_process, probe.scan.session, probe.scan.resume, "
        "probe.detection, probe.storage.run",
        tuple(f"sim_backend.{part}" for part in ("fem", "models", "phantom", "emulators")),
    ),
    ("import drivers", HARDWARE),
    ("import sim_backend.touch.table",
     ("scipy", "pydantic", "platformdirs", "sim_backend.fem", "sim_backend.scene")),
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_importing_loads_nothing_that_only_others_need(
    code: str, unloaded: tuple[str, ...]
) -> None:
    code = f"import sys; {code}; print({set(unloaded)!r} & set(sys.modules))"
    assert python("-c", code, status=0).stdout.splitlines()[-1] == "set()"
