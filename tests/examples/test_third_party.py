"""The package of an arm under examples/ installs beside palpate and keeps the contract."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from paths import ROOT

from drivers import Pose

PACKAGE = ROOT / "examples" / "palpate-franka"


def run(folder: Path, *command: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", *command], cwd=folder, env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


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
    """On a busy machine its thread came too late, and the arm stayed short of where it said to
    be."""
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
