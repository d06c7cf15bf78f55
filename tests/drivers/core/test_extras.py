"""What is not installed is named with the line that installs it."""

import subprocess
import sys
from pathlib import Path

import pytest

from drivers import MissingExtra, WallClock, open_driver
from drivers.core.extras import install_line, needs, require
from drivers.core.registry import Kind


def test_an_import_that_fails_says_what_to_install() -> None:
    with pytest.raises(MissingExtra) as said, needs("data", "a table"):
        import no_such_library  # type: ignore[import-not-found]  # noqa: F401
    assert str(said.value) == (
        "a table needs no_such_library, which is not installed: "
        f"{sys.executable} -m pip install 'palpate[data]'"
    )


def test_what_is_installed_passes() -> None:
    require("numpy", "data", "a table")
    with pytest.raises(MissingExtra, match="a stage needs no_such_library"):
        require("no_such_library", "ur", "a stage")


@pytest.mark.parametrize(
    ("version", "machine", "wheel"),
    [((3, 12), "x86_64", True), ((3, 13), "x86_64", False), ((3, 11), "aarch64", False)],
)
def test_ur_without_a_wheel_says_what_is_needed(
    version: tuple[int, int], machine: str, wheel: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.version_info", version)
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("sys.platform", "linux")
    line = install_line("ur")
    assert ("pip install 'palpate[ur]'" in line) == wheel
    assert (f"no wheel for Python {version[0]}.{version[1]}" in line) == (not wheel)


WITHOUT = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {absent!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
from probe.cli import main
sys.exit(main({arguments!r}))
"""


@pytest.mark.parametrize("absent, extra, arguments", [
    (["meshio"], "mesh", ["press", "TI", "--x", "20", "--depth", "1", "--vtu", "x.vtu"]),
    (["pandas", "xarray"], "data", ["sweep", "TI", "--vary", "modulus_kpa=10,20"]),
    (["matplotlib"], "report", ["paper"]),
    (["matplotlib"], "report", ["scan", "--scene", "TI", "--report"]),
    (["pandas", "xarray"], "data", ["calibrate", "tare", "x.csv", "--device", "d"]),
])  # fmt: skip
def test_a_command_without_its_library_is_one_line(
    absent: list[str], extra: str, arguments: list[str]
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT.format(absent=absent, arguments=arguments)],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 2
    *before, line = done.stderr.strip().splitlines()
    assert all(said.startswith("solving") for said in before)  # what takes long is said meanwhile
    assert line.endswith(f"{sys.executable} -m pip install 'palpate[{extra}]'")
    assert absent[0] in line


def test_a_dry_run_checks_without_the_library_that_draws(tmp_path: Path) -> None:
    arguments = ["scan", "--scene", "TI", "--dry-run", "--out", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT.format(absent=["matplotlib"], arguments=arguments)],
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "ok      reach and limits" in done.stdout
    assert "The probe's way is not drawn: the picture of the probe's way needs matpl" in done.stdout
    assert done.stdout.endswith("The scan can go on.\n")


@pytest.mark.parametrize("kind, driver, keys, modules", [
    ("sensors", "netft", {}, ["pynetft"]),
    ("stages", "standa", {"x_uri": "x"}, ["libximc", "libximc.highlevel"]),
])  # fmt: skip
def test_a_driver_without_its_library_gives_the_line_to_type(
    kind: Kind, driver: str, keys: dict[str, str], modules: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtra, match=rf"pip install 'palpate\[{driver}\]'"):
        open_driver(kind, driver, WallClock(), keys)
