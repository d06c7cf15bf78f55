"""`palpate import`: options, files that keep them, and several recordings at once."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from probe.storage.run import open_run

TIME_MS = 10.0 * np.arange(100)
Palpate = Callable[..., Any]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two recordings of one lab, with force in gram-force, skin and no names of ours."""
    for name in ("first.txt", "second.txt"):
        table = pd.DataFrame({"Time [ms]": TIME_MS, "Fz": -1e3 * np.ones(100)})
        table.assign(p0=1.0, p1=2.0).to_csv(tmp_path / name, index=False, sep=";", decimal=",")
    return tmp_path


KEPT = """\
force_n = "-Fz [gf]"
time_s = ["Time"]
taxels_pa = "p*"
layout = "2x1"
face_mm2 = 50
"""


@pytest.mark.parametrize("how", ["options", "file", "both"])
def test_options_and_a_file_of_them_say_the_same(how: str, folder: Path, palpate: Palpate) -> None:
    (folder / "lab.toml").write_text(KEPT + ("tare_s = 0.2\n" if how == "both" else ""))
    options = {
        "options": [
            "--map", "force_n=-Fz [gf]", "--map", "time_s=Time", "--map", "taxels_pa=p*",
            "--layout", "2x1", "--face-mm2", "50",
        ],
        "file": ["--map", folder / "lab.toml"],
        "both": ["--map", folder / "lab.toml", "--face-mm2", "25"],
    }[how]  # fmt: skip
    palpate("import", folder / "first.txt", "--out", folder / "a.run", *options, status=0)
    run = open_run(folder / "a.run")
    force_n = 0.0 if how == "both" else 9.80665
    assert run.samples()["force"].to_numpy() == pytest.approx(force_n)
    assert run.samples()["time_s"].to_numpy() == pytest.approx(1e-3 * TIME_MS)
    assert [channel.name for channel in run.channels["taxels"]] == ["r0c0", "r1c0"]
    assert run.config["face_mm2"] == (25.0 if how == "both" else 50.0)


def test_of_several_files_each_becomes_a_run(folder: Path, palpate: Palpate) -> None:
    (folder / "lab.toml").write_text(KEPT)
    (folder / "third.txt").write_text("nothing")
    keys = ["--out", folder / "runs", "--map", folder / "lab.toml", "--json"]
    made = palpate("import", folder / "*.txt", *keys, status=2)
    listed = json.loads(made.out)["runs"]
    assert [Path(one["run"]).name for one in listed] == ["first.run", "second.run", "third.txt"]
    assert "no table of numbers" in listed[2]["error"]
    assert all(open_run(folder / "runs" / f"{n}.run").recording() for n in ("first", "second"))


def test_a_folder_takes_a_single_run_too(folder: Path, palpate: Palpate) -> None:
    (folder / "lab.toml").write_text(KEPT)
    keys = ["--out", folder, "--map", folder / "lab.toml"]
    assert palpate("import", folder / "f*.txt", *keys).status == 0
    assert open_run(folder / "first.run").recording().stations


@pytest.mark.parametrize("arguments, said", [
    (["*.txt", "--out", "a.run"], "of 2 files the runs go to a folder"),
    (["first.txt", "--out", "a.run", "--layout", "4-7"], "--layout 4-7: must be rows x columns"),
    (["first.txt", "--out", "a.run", "--map", "none.toml"], "none.toml: NAME=COLUMN or a TOML"),
    (["first.txt", "--out", "a.run", "--map", "bad.toml"], "rate_hz = 'x': a number is wanted"),
    (["first.txt", "--out", "a.run", "--map", "list.toml"], r"force_n = \['a'\]: text"),
    (["first.txt", "--out", "a.run", "--scene", "NONE"], "NONE"),
])  # fmt: skip
def test_what_is_asked_wrongly_is_refused(
    arguments: list[str], said: str, folder: Path, palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "bad.toml").write_text('rate_hz = "x"')
    (folder / "list.toml").write_text('force_n = ["a"]')
    monkeypatch.chdir(folder)
    made = palpate("import", *arguments, status=2)
    assert pd.Series(" ".join(made.err.split())).str.contains(said).all(), made.err
