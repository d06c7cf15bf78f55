"""The package of an arm under examples/ installs beside palpate and keeps the contract."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from paths import ROOT

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
