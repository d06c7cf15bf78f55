"""What `import palpate` gives, what it costs, and what it says when a folder hides ours."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import palpate

HEAVY = ("PySide6", "pandas", "matplotlib", "xarray", "rtde_control", "serial", "pymodbus", "scipy")


@pytest.mark.parametrize("name", palpate.__all__)
def test_each_public_name_is_there_and_documented(name: str) -> None:
    assert getattr(palpate, name).__doc__


def test_no_name_is_lost_between_list_and_home() -> None:
    assert sorted(palpate._HOME) == sorted(palpate.__all__)
    assert set(palpate.__all__) <= set(dir(palpate))


def test_a_name_that_is_not_there_says_so() -> None:
    with pytest.raises(AttributeError, match="no attribute 'teleport'"):
        _ = palpate.teleport


def test_a_room_is_a_module() -> None:
    assert importlib.import_module("probe.detection").__name__ == "probe.detection"


def test_importing_loads_nothing_heavy() -> None:
    code = f"import sys, palpate; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("room", ["probe.guards.guard_process", "probe.scan.session"])
def test_a_scan_begins_without_scipy(room: str) -> None:
    """It takes as long as all the rest, and a scan starts two or three processes."""
    code = f"import sys, {room}; print('scipy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("package", ["drivers", "calibration", "probe", "sim_backend"])
def test_a_folder_that_hides_ours_is_named(tmp_path: Path, package: str) -> None:
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").touch()
    done = subprocess.run(
        [sys.executable, "-c", "import palpate"],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"{tmp_path / package} hides palpate's own package '{package}'" in done.stderr
