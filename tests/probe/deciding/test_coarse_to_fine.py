"""Coarse to fine: what it presses, how long, and why it stops."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from probe.config.rig import Rig
from probe.deciding.lattice import Lattice
from probe.detection.scan import detect
from probe.planning.plan import grid, repeated, row
from probe.scan.session import ScanResult, scan
from probe.storage.run import open_run
from probe.storage.verify import verify

COARSE = [0, 2, 4, 5, 7, 9, 10, 12, 14]
BESIDE = [6, 8]


@pytest.mark.parametrize("columns, rows, sizes", [
    (15, 1, [9, 15]), (60, 1, [9, 17, 33, 60]), (9, 1, [9]), (4, 1, [4]), (1, 1, [1]),
    (17, 5, [27, 85]), (9, 3, [27]),
])  # fmt: skip
def test_each_level_halves_the_gaps(columns: int, rows: int, sizes: list[int]) -> None:
    places = grid((0.004, 0.0), (0.001, 0.002), (columns, rows))
    levels = list(Lattice(places).levels())
    assert [len(level) for level in levels] == sizes
    for before, after in pairwise(levels):
        assert set(before) <= set(after) or columns == 60  # where halves are no whole stations
    assert levels[-1] == list(places)
    xs = sorted({place.x_m for place in levels[0]})
    assert (xs[0], xs[-1]) == (min(p.x_m for p in places), max(p.x_m for p in places))


def test_every_station_of_a_place_is_pressed() -> None:
    lattice = Lattice(repeated(row(0.0, 0.004, 15), 2))
    assert [place.index for place in lattice.beside([(0.0121, 0.0)])] == [4, 5, 6, 7, 8, 9]
    assert [place.index for place in next(lattice.levels())][:4] == [0, 1, 4, 5]


def scanned(winkler: Any, out: Path, scene: str, seed: int = 1, **keys: float) -> ScanResult:
    rig = Rig.model_validate({
        "scan": {"hold_s": 5.0, "planner": "coarse-to-fine"}, "planner": keys,
        "sensor": [{"driver": "virtual", "rate_hz": 100}],
    })  # fmt: skip
    return scan(rig, scene, out, seed=seed, respond=winkler)


def pressed(run: ScanResult) -> list[int]:
    return [station.index for station in open_run(run).recording().stations]


def test_it_stops_when_it_is_decided(tmp_path: Path) -> None:
    run = scanned(None, tmp_path, "TIHA", misses=0.1)  # half of it is its chance of disease
    assert run.ended.reason.startswith("decided after 11 of 15 stations: artery, ")
    assert pressed(run) == sorted(COARSE + BESIDE)
    assert verify(run).ok
    assert detect(run).finding == "artery"
    again = scanned(None, tmp_path, "TIHA", misses=0.1)
    holds = [
        [s.retract_s - s.hold_s for s in open_run(one).recording().stations] for one in (run, again)
    ]
    assert holds[0] == holds[1] == [pytest.approx(2.5, abs=0.01)] * 11


def test_nothing_is_said_of_all_stations_only(winkler: Any, tmp_path: Path) -> None:
    run = scanned(winkler, tmp_path, "TI")
    assert run.ended.reason == "every station is complete"
    assert len(pressed(run)) == 15
    assert detect(run).finding == "nothing"


@pytest.mark.parametrize("keys, count, said", [
    ({"presses": 3}, 3, "3 presses are made"),
    ({"contact_s": 21}, 5, "17.5 s of contact"),  # a sixth press may take 6 s
    ({"dose_n_s": 10}, 2, "a dose of"),  # of about 1 N, and for 6 s at most
])  # fmt: skip
def test_it_keeps_its_limits(
    winkler: Any, tmp_path: Path, keys: dict[str, float], count: int, said: str
) -> None:
    run = scanned(winkler, tmp_path, "TIT", **keys)
    assert run.ended.reason.startswith(said)
    assert pressed(run) == COARSE[:count]


def test_noise_that_hides_a_pulse_prolongs_the_holds(winkler: Any, tmp_path: Path) -> None:
    rig = Rig.model_validate({
        "scan": {"hold_s": 5.0, "planner": "coarse-to-fine"}, "planner": {"presses": 2},
        "sensor": [{"driver": "virtual", "rate_hz": 100, "noise_mn": 10}],
    })  # fmt: skip
    stations = open_run(scan(rig, "TIT", tmp_path, respond=winkler)).recording().stations
    assert [s.retract_s - s.hold_s for s in stations] == [pytest.approx(5.0, abs=0.01)] * 2
