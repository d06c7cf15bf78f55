"""Every script, notebook and package under examples/ works as it is, in an empty folder."""

import ast
import json
import os
import runpy
import shutil
import time
from pathlib import Path
from typing import Any

import pytest
from paths import ROOT
from programs import python

from drivers import Pose

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
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


PACKAGE = ROOT / "examples" / "palpate-franka"


def run(folder: Path, *command: str) -> str:
    env = os.environ | {"PYTHONPATH": str(folder)}
    return python("-m", *command, cwd=folder, env=env, status=0).stdout


def test_it_installs_and_keeps_the_contract(tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "installed"
    shutil.copytree(PACKAGE, source)
    run(tmp_path, "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index",
        "--target", str(target), str(source))  # fmt: skip
    said = run(
        target, "pytest", "-q", "-p", "no:cacheprovider", "--palpate-driver=franka",
        "--palpate-bench=palpate_franka.bench:bench",
    )  # fmt: skip
    assert "6 passed, 7 skipped" in said  # the seven are of sensors


def test_it_moves_until_the_arm_was_given_the_end_of_its_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(PACKAGE)
    from palpate_franka import bench, stage

    monkeypatch.setattr(stage, "PERIOD_S", 0.1)
    settings = stage.FrankaSettings(simulated=True, origin_mm=(400.0, 0.0, 120.0))
    arm = stage.FrankaStage(settings, bench.connect_stand_in)
    arm.connect()
    try:
        arm.move(Pose(0.0, 0.0, 4e-4), 0.02)  # 20 ms, and as near as counts for a compliant arm
        deadline_s = time.monotonic() + 10.0
        while arm.moving() and time.monotonic() < deadline_s:
            time.sleep(0.001)
        assert arm.pose()[2] == pytest.approx(4e-4, abs=1e-9)
    finally:
        arm.close()
