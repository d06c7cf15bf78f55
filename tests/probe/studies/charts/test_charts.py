"""The charts' cells and verdicts, and FElupe, which shares nothing with our solver but the mesh."""

import subprocess
import sys
from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from probe.studies.charts import stability
from probe.studies.charts.cells import Cell, cells
from probe.studies.charts.kept_rows import kept_rows, rows_of, write_rows
from probe.studies.charts.peers import felupe_forces
from probe.studies.charts.speed_accuracy import pareto, spent_s
from probe.studies.charts.stability import chart, draw, judge
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.models.press import CannotSolve, Press, press
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.waves import PA_PER_MMHG


def test_at_least_1000_cells_that_are_all_scenes() -> None:
    all_cells = cells()
    assert len(all_cells) >= 1000
    assert len({(c.family, c.row, c.value) for c in all_cells}) == len(all_cells)
    assert len({c.key for c in all_cells}) == len(all_cells)
    for cell in all_cells[::7]:
        Scene.model_validate(cell.scene)


def cell_of(family: str, row: str, value: str) -> Cell:
    return next(c for c in cells() if (c.family, c.row, c.value) == (family, row, value))


@pytest.mark.parametrize("family, row, value", [
    ("contrast", "TIT, stress", "10000"),
    ("cover [mm]", "TIT, stress", "0.3"),
    ("finger at x [mm]", "cylinder, stress", "1"),
    ("way of loading: depth [mm]", "reversal, stress", "1"),
])  # fmt: skip
def test_hard_cells_agree_with_an_independent_solution(family: str, row: str, value: str) -> None:
    judged = judge(cell_of(family, row, value))
    assert judged["verdict"] == "solved", judged
    assert judged["error_pct"] < 5


def test_a_limit_is_refused_with_its_physics() -> None:
    judged = judge(cell_of("pressure [mmHg]", "wall of 25 kPa", "400"))
    assert judged["verdict"] == "refused"
    assert "mmHg" in judged["reason"]


def test_an_unstable_answer_that_is_stated_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = cell_of("small strain: depth [mm]", "TI, stress", "0.02")
    assert judge(cell)["verdict"] == "solved"

    def balanced(*asked: Any, **options: Any) -> Press:
        found = press(*asked, **options)
        return replace(found, states=tuple(replace(s, stable=False) for s in found.states))

    monkeypatch.setattr(stability, "press", balanced)
    judged = judge(cell)
    assert (judged["verdict"], judged["reason"]) == ("wrong", "stated, and not stable")


@pytest.mark.parametrize(("second", "verdict"), [(1.0, "solved"), (2.0, "wrong"), (None, "wrong")])
def test_a_difference_on_a_coarse_mesh_alone_is_for_another_element(
    second: float | None, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first element is far off; the second finds ``second`` times the answer, or nothing."""

    def independent(_cell: Cell, _scene: Scene, element: str, finer: int) -> tuple[float, ...]:
        factor = {("Q8R", 1): 2.0, ("Q8R", 2): None}.get((element, finer), second)
        if factor is None:
            raise CannotSolve("greatest depth", "nothing found")
        return (factor * 10.0,)

    monkeypatch.setattr(stability, "_independent", independent)
    cell = replace(shallow(0.05), how="finite")
    answer = stability.Answer((10.0,), 1.0, stable=True)
    checked = stability._checked(cell, Scene.model_validate(cell.scene), answer)
    assert checked["verdict"] == verdict


def shallow(depth_mm: float) -> Cell:
    scene = load_scene("TI").model_dump(mode="json", exclude_none=True)
    return Cell("f", "r", f"{depth_mm:g}", scene, "small", depth_mm=depth_mm)


def here(left: Sequence[Cell], _workers: int) -> Generator[dict[str, Any]]:
    """In place of the workers, each of which takes a second to start."""
    yield from map(judge, left)


def test_a_second_start_solves_only_what_is_new_or_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stability, "judged", here)
    chart(tmp_path, progress=lambda _: None, workers=1, chosen=[shallow(0.05)])
    file = tmp_path / "stability.csv"
    kept = pd.read_csv(file)
    kept.assign(force_n_per_m=-1.0).to_csv(file, index=False)  # as no solution would be
    (tmp_path / "stability.png").unlink()

    said: list[str] = []
    both = [shallow(0.02), shallow(0.05)]
    table = chart(tmp_path, progress=said.append, workers=1, chosen=both)
    assert said == [f"1 of 2 cells are in {file}; 1 are to be solved"]
    assert table.value.tolist() == ["0.02", "0.05"], "in the order of the cells"
    assert table.force_n_per_m[1] == -1.0 < table.force_n_per_m[0]
    assert pd.read_csv(file).key.tolist() == [cell.key for cell in both]
    assert (tmp_path / "stability.png").stat().st_size > 1000

    stiffer = shallow(0.05)
    stiffer.scene["tissue"]["modulus_kpa"] = 60.0
    table = chart(tmp_path, progress=said.append, workers=1, chosen=[both[0], stiffer])
    assert said[1] == f"1 of 2 cells are in {file}; 1 are to be solved"
    assert len(table) == 2, "what is no longer a cell is left out"
    assert table.force_n_per_m[1] == pytest.approx(1.2 * kept.force_n_per_m[0], rel=1e-3)


def test_each_row_is_kept_when_it_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held: list[int] = []

    def write(file: Path, rows: list[dict[str, Any]]) -> None:
        write_rows(file, rows)
        held.append(len(rows_of(file)))
        if len(rows) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(stability, "write_rows", write)
    monkeypatch.setattr(stability, "judged", here)
    chosen = [shallow(depth) for depth in (0.02, 0.03, 0.05)]
    with pytest.raises(KeyboardInterrupt):
        chart(tmp_path, progress=lambda _: None, workers=1, chosen=chosen)
    assert held == [1, 2]
    assert [row["value"] for row in rows_of(tmp_path / "stability.csv")] == ["0.02", "0.03"]


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


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # FElupe's use of its dependencies
def test_felupe_agrees_on_force_and_pulse(monkeypatch: pytest.MonkeyPatch) -> None:
    felupe = pytest.importorskip("felupe")
    monkeypatch.setattr(felupe.NeoHooke, "chunksize", 256, raising=False)
    scene = load_scene("TIHA").model_copy(update={"plane": "strain"})
    place = 32e-3, 1e-3, [80 * PA_PER_MMHG, 120 * PA_PER_MMHG], 2e-3
    theirs, _ = felupe_forces(scene, *place)
    _, found = solve_finite(scene, *place, "Q4M")
    ours = [one.force_n_per_m for one in found]
    assert ours == pytest.approx(theirs, rel=2e-3)
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0], rel=0.02)


def test_plane_stress_is_not_compared() -> None:
    pytest.importorskip("felupe")
    with pytest.raises(ValueError, match="plane strain"):
        felupe_forces(load_scene("TIHA"), 32e-3, 1e-3, [0.0], 2e-3)
