"""``palpate runs``: a folder of runs is listed, filtered and sorted."""

import re
from pathlib import Path
from typing import Any

import pytest

from probe.config.rig import Rig
from probe.scan.session import scan
from probe.storage.run import open_run
from probe.storage.writer import create_store

ONE = Rig.model_validate({"scan": {"start_mm": 32, "stations": 1}})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> Path:
    out = tmp_path_factory.mktemp("runs")
    scan(ONE, "TIHA", out, labels={"operator": "Ann", "gel": "yes"}, respond=winkler)
    scan(ONE, "TI", out / "more", labels={"operator": "Bob"}, respond=winkler)
    (out / "torn.run").write_bytes(b"SQLite format 3\0 and no more")
    return out


def listed(palpate: Any, folder: Path, *options: str) -> list[dict[str, Any]]:
    outcome = palpate("runs", folder, "--json", *options, status=0)
    return outcome.json["runs"]


def test_all_runs_are_listed_and_a_torn_one_says_why(palpate: Any, folder: Path) -> None:
    found = {one["scene"]: one for one in listed(palpate, folder)}
    assert set(found) == {"TIHA", "TI", ""}
    assert "damaged or not a run file" in found[""]["problem"]
    assert found["TIHA"]["labels"] == {"operator": "Ann", "gel": "yes"}
    assert found["TIHA"]["simulated"]
    assert found["TIHA"]["stations"] == 1
    assert found["TIHA"]["finish"] == "completed"


@pytest.mark.parametrize("options, scenes", [
    (("--operator", "Ann"), ["TIHA"]),
    (("--note", "gel=yes"), ["TIHA"]),
    (("--scene", "TI"), ["TI"]),
    (("--real",), [""]),
    (("--since", "2999-01-01"), []),
    (("--simulated", "--sort", "scene"), ["TI", "TIHA"]),
])  # fmt: skip
def test_filters(palpate: Any, folder: Path, options: tuple[str, ...], scenes: list[str]) -> None:
    assert [one["scene"] for one in listed(palpate, folder, *options)] == scenes


def test_the_table_names_each_run(palpate: Any, folder: Path) -> None:
    outcome = palpate("runs", folder)
    assert "Ann, gel=yes" in " ".join(outcome.out.split())
    for run in folder.rglob("*.run"):  # whole, to be copied
        assert any(line.split()[:1] == [str(run)] for line in outcome.out.splitlines())


def test_a_run_is_one_line_of_a_terminal(
    palpate: Any, tmp_path: Path, winkler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    made = scan(ONE, "TIHA", "runs", respond=winkler).path
    lines = palpate("runs", "runs").out.splitlines()
    (line,) = [line for line in lines if made.name in line]
    assert line.split()[-1] == "completed"
    assert re.search(r" 20\d\d-\d\d-\d\d \d\d:\d\d ", line)
    assert max(map(len, lines)) <= 80


def test_nothing_is_folded_into_a_pipe(palpate: Any, tmp_path: Path, winkler: Any) -> None:
    labels = {"operator": "Ann", "tissue": "liver of a pig, a day old"}
    made = scan(ONE, "TIHA", tmp_path, respond=winkler, labels=labels).path
    (line,) = [line for line in palpate("runs", tmp_path).out.splitlines() if made.name in line]
    assert line.rstrip().endswith("completed  Ann, tissue=liver of a pig, a day old")


def test_labels_are_in_the_run(folder: Path) -> None:
    (path,) = folder.glob("TIHA*.run")
    assert open_run(path).config["labels"] == {"operator": "Ann", "gel": "yes"}


@pytest.mark.parametrize("command, key", [
    (("detect",), "finding"),
    (("verify",), "ok"),
    (("export", "--to", "csv"), "files"),
    (("report",), "report"),
])  # fmt: skip
def test_a_torn_run_stops_no_other(
    palpate: Any, folder: Path, tmp_path: Path, command: tuple[str, ...], key: str
) -> None:
    runs = sorted(folder.rglob("*.run"), key=lambda run: run.name != "torn.run")
    assert runs[0].name == "torn.run"
    out = ("--out", tmp_path) if command[0] in ("export", "report") else ()
    outcome = palpate(*command, *runs, *out, "--json", status=2)
    reported = outcome.json["reports" if command[0] == "report" else "runs"]
    assert [Path(one["run"]).name for one in reported] == [run.name for run in runs]
    assert [key in one and "error" not in one for one in reported] == [
        command[0] == "verify" and "error" not in reported[0],
        True,
        True,
    ]
    said = palpate(*command, *runs, *out, status=2)
    assert "torn.run" in said.err + said.out
    assert all(run.stem in said.out for run in runs[1:])


def test_what_is_no_run_opens_no_window(
    palpate: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Path] = []
    monkeypatch.setattr("probe.cli.runs.need_windows", lambda: None)
    monkeypatch.setattr("probe.gui.app.run_live", lambda path: shown.append(path) or 0)
    empty, text, begun = (tmp_path / name for name in ("empty.run", "text.run", "begun.run"))
    empty.touch()
    text.write_text("my notes")
    for path, said in (
        (empty, "nothing has been stored in it yet"),
        (text, "damaged or not a run file"),
        (folder / "torn.run", "damaged or not a run file"),
        (tmp_path, "a folder; give the run file in it"),
    ):
        outcome = palpate("live", path)
        assert (outcome.status, outcome.err.startswith(f"{path}: {said}")) == (2, True), outcome.err
    assert not shown
    with create_store(begun):  # whose scan has not said anything yet
        assert palpate("live", begun).status == 0
    run = next(folder.glob("TIHA*.run"))
    for path in (run, tmp_path / "later.run"):  # one that is not there yet is waited for
        outcome = palpate("live", path)
        assert (outcome.status, f"Waiting for {path}" in outcome.err) == (0, path != run)
    assert shown == [begun, run, tmp_path / "later.run"]


def test_some_stations_are_scanned_with_another_key_and_one_is_redone(
    palpate: Any, tmp_path: Path
) -> None:
    asked = ("--stations", "2-3,5", "--set", "scan.pitch_mm=3", "--seed", 1)
    outcome = palpate("scan", "--scene", "TI", "--out", tmp_path, *asked, "--json", status=0)
    assert [(s["station"], s["x_mm"]) for s in outcome.json["stations"]] == [
        (2, 7.0), (3, 10.0), (5, 16.0),
    ]  # fmt: skip
    run = outcome.json["run"]
    assert open_run(run).config["rig"]["scan"]["pitch_mm"] == 3.0
    again = palpate("resume", run, "--redo", "3", "--set", "scan.indentation_mm=2", "--json")
    assert again.status == 0, again.err
    level_pa = {s["station"]: s["baseline_pa"] for s in again.json["stations"]}
    assert level_pa[3] < 0.9 * level_pa[2]
