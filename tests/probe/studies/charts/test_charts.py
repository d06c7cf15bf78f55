"""The charts' cells and verdicts."""

import subprocess
import sys
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from probe.studies.charts.cells import Cell, cells
from probe.studies.charts.kept_rows import kept_rows
from probe.studies.charts.speed_accuracy import pareto, spent_s
from probe.studies.charts.stability import draw, judge
from sim_backend.scene.scene_file import Scene


def test_at_least_300_cells_that_are_all_scenes() -> None:
    all_cells = cells()
    assert len(all_cells) >= 300
    assert len({(c.family, c.row, c.value) for c in all_cells}) == len(all_cells)
    for cell in all_cells[::7]:
        Scene.model_validate(cell.scene)


def cell_of(family: str, row: str, value: str) -> Cell:
    return next(c for c in cells() if (c.family, c.row, c.value) == (family, row, value))


@pytest.mark.parametrize(
    ("family", "row", "value"),
    [
        ("contrast", "TIT, stress", "10000"),
        ("cover [mm]", "TIT, stress", "0.3"),
        ("finger at x [mm]", "cylinder, stress", "1"),
        ("way of loading: depth [mm]", "reversal, stress", "1"),
    ],
)
def test_hard_cells_agree_with_an_independent_solution(family: str, row: str, value: str) -> None:
    judged = judge(cell_of(family, row, value))
    assert judged["verdict"] == "solved", judged
    assert judged["error_pct"] < 5


def test_a_limit_is_refused_with_its_physics() -> None:
    judged = judge(cell_of("pressure [mmHg]", "wall of 25 kPa", "400"))
    assert judged["verdict"] == "refused"
    assert "mmHg" in judged["reason"]


def test_the_front_is_what_nothing_beats() -> None:
    table = pd.DataFrame({"processor_s": [1.0, 2.0, 3.0, 4.0], "e": [5.0, 6.0, 1.0, np.nan]})
    assert list(pareto(table, "e").processor_s) == [1.0, 3.0]


def test_the_time_of_a_peer_is_that_of_the_program_that_was_started() -> None:
    spend = "import time\nwhile time.process_time() < 0.1: pass"
    began_s, own_s = spent_s(), process_time()
    subprocess.run([sys.executable, "-c", spend], check=True)
    assert spent_s() - began_s > 0.09 > process_time() - own_s


def test_every_verdict_is_drawn() -> None:
    rows = [
        {"family": "f", "row": "r", "value": str(n), "verdict": verdict, "error_pct": 1.0}
        for n, verdict in enumerate(["solved", "breaks", "refused", "wrong", "hangs"])
    ]
    assert isinstance(draw(pd.DataFrame(rows)), Figure)


def test_a_chart_that_is_broken_off_keeps_its_rows(tmp_path: Path) -> None:
    said: list[str] = []
    with (
        pytest.raises(KeyboardInterrupt),
        kept_rows(tmp_path / "charts" / "stability.csv", said.append) as rows,
    ):
        rows += [{"cell": 1, "error_pct": 0.5}, {"cell": 2, "reason": "refused"}]
        raise KeyboardInterrupt
    table = pd.read_csv(tmp_path / "charts" / "stability.csv")
    assert table["cell"].tolist() == [1, 2]
    assert said == [f"2 rows are kept in {tmp_path / 'charts' / 'stability.csv'}"]
