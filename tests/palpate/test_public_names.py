"""What `import palpate` gives, what it costs, and what it says when a folder hides ours."""

import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from paths import ROOT

import palpate


@pytest.mark.parametrize("name", palpate.__all__)
def test_each_public_name_is_there_and_documented(name: str) -> None:
    assert getattr(palpate, name).__doc__


def test_no_name_is_lost_between_list_and_home() -> None:
    assert sorted(palpate._HOME) == sorted(palpate.__all__)
    assert set(palpate.__all__) <= set(dir(palpate))


def test_a_name_that_is_not_there_says_so() -> None:
    with pytest.raises(AttributeError, match="no attribute 'teleport'"):
        _ = palpate.teleport


def test_a_type_checker_sees_the_real_names_only(tmp_path: Path) -> None:
    """`palpate.nonexistent()` passed mypy --strict."""
    pytest.importorskip("mypy", reason="mypy is not installed (extra: dev)")
    script = tmp_path / "uses.py"
    script.write_text("import palpate\nfound = palpate.detect('a.run')\npalpate.nonexistent()\n")
    config = tmp_path / "mypy.ini"
    config.write_text("[mypy]\nfollow_imports = silent\n")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--config-file", str(config), str(script)],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=250,
    )  # fmt: skip
    assert 'uses.py:3: error: Module has no attribute "nonexistent"' in done.stdout
    assert "Found 1 error" in done.stdout


FUNCTIONS = [name for name in palpate.__all__ if inspect.isfunction(getattr(palpate, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_parameter_of_a_public_function_is_described(name: str) -> None:
    """In numpydoc's form, whose types the site takes from the signature."""
    function = getattr(palpate, name)
    docstring = inspect.getdoc(function) or ""
    table = docstring.partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    described = re.findall(r"^(\w+)\n    \S", table, re.MULTILINE)
    assert described == list(inspect.signature(function).parameters)


def test_a_room_is_a_module() -> None:
    assert importlib.import_module("probe.detection").__name__ == "probe.detection"


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
