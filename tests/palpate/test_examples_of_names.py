"""Every public name has an example, and it runs: in its docstring, or on a page of the site."""

import doctest
import inspect
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from paths import ROOT

import palpate

ON_PAGES = {
    "Calibration": "probe/calibrate/fits.py",  # a union of types has no docstring of its own
    "Rig": "docs/how-to/rig.md",
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
