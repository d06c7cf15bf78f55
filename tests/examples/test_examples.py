"""Every script and notebook under examples/ runs as it is, in an empty folder."""

import ast
import json
import runpy
from pathlib import Path
from typing import Any

import pytest
from paths import ROOT

EXAMPLES = ROOT / "examples"
SAYS = {
    "first_scan": "artery at x = 3",
    "press_and_sweep": "400.0",
    "own_wave": "completed",
    "own_detector": "32.0 mm",
    "import_recording": "artery",
    "compare_two_runs": "diseased: B",
    "mujoco_arm": "the finite elements' force there",
}
NEEDS = {"mujoco_arm": "mujoco"}
"""What is not palpate's to bring."""


def test_each_script_is_run_here() -> None:
    assert sorted(path.stem for path in EXAMPLES.glob("*.py")) == sorted(SAYS)


@pytest.mark.parametrize("name", SAYS)
def test_a_script_runs_and_says_what_it_is_for(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert SAYS[name] in capsys.readouterr().out


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda p: p.stem)
def test_a_notebook_runs_and_shows_its_last_lines(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    shown = [_run("".join(cell["source"]), names) for cell in _code(path)]
    assert all(hasattr(one, "_repr_html_") for one in shown)


def _code(path: Path) -> list[dict[str, Any]]:
    return [c for c in json.loads(path.read_text())["cells"] if c["cell_type"] == "code"]


def _run(source: str, names: dict[str, Any]) -> Any:
    """Run a cell as a notebook does, and give the value of its last line."""
    *body, last = ast.parse(source).body
    assert isinstance(last, ast.Expr)
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)
