"""What `pytest --palpate-driver` says before it opens anything."""

import subprocess
import sys
from pathlib import Path


def test_a_driver_that_needs_keys_asks_for_a_rig(tmp_path: Path) -> None:
    """It ended in pydantic's own errors, one a test."""
    command = [sys.executable, "-m", "pytest", "--palpate-driver=grbl"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "'grbl' needs port: give --palpate-rig RIG.toml" in done.stdout
    assert "ValidationError" not in done.stdout
