"""Decide: where it presses, when it stops, and what it then says."""

from pathlib import Path

import pytest

import palpate
from probe.config.scan_planner import planner_for
from probe.deciding.decide import Decide
from probe.planning.contract import check_planner


def decided(scene: str, folder: Path, noise_mn: float = 0.5, **keys: float) -> palpate.Run:
    rig = palpate.default_rig(palpate.load_scene(scene))
    scan = rig.scan.model_copy(update={"hold_s": 5.0, "planner": "decide"})
    sensor = rig.sensor[0].model_copy(update={"noise_mn": noise_mn})
    rig = rig.model_copy(update={"scan": scan, "sensor": (sensor,), "planner": keys})
    return palpate.open_run(palpate.scan(rig, scene, folder, seed=4).path)


@pytest.mark.parametrize(
    ("scene", "kind", "most"),
    [("TI", "nothing", 6), ("TIHA", "artery", 6), ("TISA", "stenotic artery", 6),
     ("TIT", "tumour", 10)],
)  # fmt: skip
def test_it_names_what_lies_there_from_a_few_presses(
    scene: str, kind: str, most: int, tmp_path: Path
) -> None:
    run = decided(scene, tmp_path)
    stations, found = run.recording().stations, palpate.detect(run.path)
    assert 3 <= len(stations) <= most
    assert all(s.retract_s - s.hold_s == pytest.approx(2.5, abs=0.02) for s in stations)
    assert f"of 15 stations: {kind}, " in run.recording().ended
    assert found.finding == kind
    for thing in found.objects:
        low_mm, high_mm = thing.position_ci_mm
        assert low_mm < 32 < high_mm and high_mm - low_mm <= 8


def test_the_first_presses_are_spread_and_the_next_are_beside_what_shows(tmp_path: Path) -> None:
    run = decided("TIT", tmp_path, presses=4)
    plan = palpate.plan_for(palpate.default_rig())
    whole = palpate.open_run(palpate.scan(palpate.default_rig(), "TIT", tmp_path / "all").path)
    presses = check_planner(lambda plan: Decide(plan, presses=4), plan, whole.recording())
    order = [press.place.index for press in presses]
    assert order[:3] == [7, 2, 12]
    assert all(abs(index - 7) <= 4 for index in order[3:])
    assert len(run.recording().stations) == 4
    assert run.recording().ended.startswith("4 presses are made")


def test_a_grid_is_refused() -> None:
    scan = {"start_mm": [4, 0], "pitch_mm": [4, 4], "stations": [5, 2], "planner": "decide"}
    rig = palpate.Rig.model_validate({"scan": scan})
    with pytest.raises(palpate.RigError, match='along one row; for a grid say "coarse-to-fine"'):
        planner_for(rig, palpate.plan_for(rig))
