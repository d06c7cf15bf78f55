"""Presses by an array in counts: `palpate import`, and `palpate detect --empty`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import skin

from probe.storage.run import open_run

Palpate = Callable[..., Any]
EMPTY, OVER = 24, 6  # presses, those over nothing first
MAP = ("--map", "station=press", "--map", "taxels_counts=taxel*", "--map", "x_mm=x_m [m]")


def table(
    folder: Path, name: str, presses: np.ndarray[Any, Any], place: np.ndarray[Any, Any]
) -> Path:
    """A CSV with a row per frame, as other programs write it: no times, no unit, words."""
    rows = pd.DataFrame(
        presses.reshape(-1, skin.TAXELS).round(), columns=[f"taxel{n}" for n in range(skin.TAXELS)]
    )
    frames = presses.shape[1]
    rows.insert(0, "press", np.repeat(np.arange(len(presses)), frames))
    rows.insert(1, "label", "unknown")
    rows.insert(2, "x_m", np.repeat(1e-2 * place, frames))
    rows.to_csv(folder / name, index=False)
    return folder / name


@pytest.fixture
def counts(tmp_path: Path) -> Path:
    """A folder with presses over nothing at six places, and others at two more, over a lump."""
    rng = np.random.default_rng(2)
    presses = np.concatenate(
        [*(skin.films(rng, 4) for _ in range(6)), skin.films(rng, OVER, 200.0)]
    )
    place = np.concatenate([np.repeat(np.arange(6), 4), np.repeat([7, 8], 3)])
    table(tmp_path, "all.csv", presses, place)
    table(tmp_path, "empty.csv", presses[:EMPTY], place[:EMPTY])
    table(tmp_path, "over.csv", presses[EMPTY:], place[EMPTY:])
    return tmp_path


def test_a_table_of_presses_in_counts_comes_in_as_counts(counts: Path, palpate: Palpate) -> None:
    done = palpate(
        "import", counts / "all.csv", "--out", counts / "a.run", *MAP, "--rate-hz", "2", status=0
    )
    assert done.err.count("the readings are counts") == 1
    run = open_run(counts / "a.run")
    recording = run.recording(any_unit=True)
    assert recording.unit == "counts" == run.channels["imported"][0].unit
    assert [station.index for station in recording.stations] == list(range(EMPTY + OVER))
    first = pd.read_csv(counts / "all.csv").filter(like="taxel").to_numpy()[: skin.SAMPLES]
    assert recording.stations[0].signal_pa == pytest.approx(first)
    assert palpate("report", counts / "a.run", status=2).err.count("is in 'counts'") == 1


@pytest.mark.parametrize("over_nothing", ["stations", "run"])
def test_presses_unlike_those_over_nothing_are_named(
    over_nothing: str, counts: Path, palpate: Palpate
) -> None:
    for name in ("all", "empty", "over"):
        source, out = counts / f"{name}.csv", counts / f"{name}.run"
        palpate("import", source, "--out", out, *MAP, "--rate-hz", "2", status=0)
    run, empty = {
        "stations": (counts / "all.run", f"1-{EMPTY}"),
        "run": (counts / "over.run", str(counts / "empty.run")),
    }[over_nothing]
    found = palpate("detect", run, "--empty", empty, "--json", status=0).json
    assert found["finding"] == "undecided"
    assert found["empty"] == {"presses": EMPTY, "places": 6}
    chances = [one["unlike_empty_chance"] for one in found["stations"]]
    assert chances[-OVER:] == [pytest.approx(1 / (EMPTY + 1))] * OVER
    assert chances[:-OVER] == [None] * (len(chances) - OVER)
    said = palpate("detect", run, "--empty", empty, status=0).out
    assert f"{OVER} of {OVER} stations (0.24 by chance): {len(chances) - OVER + 1}, " in said


@pytest.mark.parametrize(("empty", "said"), [
    ("nope.run", "no such run file"),
    ("99", "no complete station 99"),
    ("1-2", "too few presses over nothing"),
])  # fmt: skip
def test_what_is_no_press_over_nothing_is_said(
    empty: str, said: str, counts: Path, palpate: Palpate
) -> None:
    out = counts / "a.run"
    palpate("import", counts / "over.csv", "--out", out, *MAP, "--rate-hz", "2", status=0)
    done = palpate("detect", out, "--empty", empty, status=2)
    assert said in done.err
    assert f"--empty {empty}" in done.err


def test_counts_are_asked_of_no_column_in_pascals(counts: Path, palpate: Palpate) -> None:
    said = palpate(
        "import", counts / "over.csv", "--out", counts / "a.run", "--rate-hz", "2",
        "--map", "taxels_counts=taxel* [Pa]", status=2,
    ).err  # fmt: skip
    assert "is in Pa; wanted is one of counts" in said
