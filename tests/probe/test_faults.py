"""A small fault campaign; the large one is `python benchmarks/faults.py`."""

import sys
from pathlib import Path

import numpy as np
import pytest

from drivers import SimulatedClock

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from fault_kills import KILLS, kill_one
from fault_runs import KINDS, REAL_TIME_FAULTS, Struck, check_file, run_one

QUICK = [kind for kind in KINDS if kind not in REAL_TIME_FAULTS]


@pytest.mark.parametrize("kind", QUICK)
def test_no_fault_presses_too_hard_or_loses_data(kind: str) -> None:
    one = run_one(1, kind)
    assert one.wrong == ()
    if kind not in ("observer fails", "pause storm", "slow disk", "disk hangs"):
        assert one.finish != "completed"


@pytest.mark.slow
@pytest.mark.parametrize("kind", REAL_TIME_FAULTS)
def test_nor_in_real_time(kind: str) -> None:
    assert run_one(1, kind).wrong == ()


@pytest.mark.parametrize("kind", KILLS)
def test_no_killed_process_loses_data(kind: str) -> None:
    assert kill_one(1, kind).wrong == ()


@pytest.mark.parametrize(
    ("kind", "at_s"), [("stage lost", 7.4506), ("sensor silent", 7.2098), ("sensor silent", 9.9257)]
)
def test_between_a_press_and_its_last_sample(kind: str, at_s: float, tmp_path: Path) -> None:
    """The probe is up again, but not every sample of the press is in when the fault strikes."""
    struck = Struck(kind, at_s, np.random.default_rng(1), tmp_path / "scan.run")
    struck.scan(SimulatedClock())
    assert check_file(struck.path, struck.told, struck.committed) == []
