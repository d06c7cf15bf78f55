"""What `import palpate` gives, with an example each, and what it says when a folder hides ours."""

import doctest
import importlib
import inspect
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from paths import ROOT
from programs import python

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
    pytest.importorskip("mypy", reason="mypy is not installed (extra: dev)")
    script = tmp_path / "uses.py"
    script.write_text(
        "import palpate\nfound = palpate.detect('a.run')\npalpate.nonexistent()\n"
        "rig = palpate.Rig(scan=palpate.Scan(start_mm=8.0, stations=13))\n"
    )
    config = tmp_path / "mypy.ini"
    config.write_text("[mypy]\nfollow_imports = silent\n")
    done = python("-m", "mypy", "--strict", "--config-file", config, script, cwd=ROOT)
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
    done = python("-c", "import palpate", cwd=tmp_path, status=1)
    assert f"{tmp_path / package} hides palpate's own package '{package}'" in done.stderr


ON_PAGES = {
    "Calibration": "probe/calibrate/fits.py",  # a union of types has no docstring of its own
    **dict.fromkeys(("Device", "Rig", "Safety", "Scan", "SceneChoice"), "docs/how-to/rig.md"),
    "Scene": "docs/how-to/notebook.md",
    "write_report": "docs/how-to/runs.md",  # takes seconds
}
"""Where the others are used: docstrings of models describe the keys of files to editors."""
LOADS = "raw,load_n\n0.211,0\n1.508,1\n2.812,2\n4.109,3\n2.810,2\n1.510,1\n0.209,0\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """What the examples name: a run, a rig, a recording and readings of loads."""
    made = tmp_path_factory.mktemp("examples")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        shutil.copy(palpate.scan(scene="TIHA", seed=1).path, "TIHA.run")
        shutil.copy(ROOT / "rigs" / "virtual.toml", "rig.toml")
        rows = "".join(f"{n / 100},{0.5 + 0.01 * (n % 80)}\n" for n in range(500))
        Path("press.csv").write_text("time_s,force_n\n" + rows)
        Path("loads.csv").write_text(LOADS)
        yield made


@pytest.mark.parametrize("name", sorted(set(palpate.__all__) - set(ON_PAGES)))
def test_the_example_in_its_docstring_runs(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Path.cwd() == folder
    text = inspect.getdoc(getattr(palpate, name)) or ""
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    assert example.examples, f"palpate.{name} has no example in its docstring"
    if inspect.isfunction(getattr(palpate, name)):
        assert any(f"palpate.{name}(" in one.source for one in example.examples)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    failed = runner.run(example).failed
    assert not failed, capsys.readouterr().out


@pytest.mark.parametrize("name", ON_PAGES)
def test_the_example_elsewhere_is_there(name: str) -> None:
    """The pages' own test runs what they show, the test above the docstrings."""
    assert f"palpate.{name}" in (ROOT / ON_PAGES[name]).read_text(encoding="utf-8")
