"""A small fault campaign; the large one is `python benchmarks/faults.py`."""

import runpy
from pathlib import Path

import pytest

CAMPAIGN = runpy.run_path(str(Path(__file__).resolve().parents[2] / "benchmarks" / "faults.py"))


@pytest.mark.parametrize("kind", CAMPAIGN["KINDS"])
def test_no_fault_presses_too_hard_or_loses_data(kind: str) -> None:
    outcomes = [CAMPAIGN["run_one"](seed, kind) for seed in (1, 2, 3)]
    assert [one.wrong for one in outcomes] == [()] * 3
    if kind not in ("observer fails", "pause storm", "surface higher"):
        assert any(one.finish != "completed" for one in outcomes)
