"""Breaking the source at random: every file has tests to ask; a survivor is told from a catch."""

from pathlib import Path

import pytest
from mutants import places, rooms, witnesses
from paths import ROOT


def test_every_file_has_tests_that_are_there() -> None:
    for room, files in rooms().items():
        for file in files:
            assert all((ROOT / test).exists() for test in witnesses(file)), (room, file)
            assert witnesses(file)[-1] != Path("tests"), f"no tests mirror {file}"


def test_a_place_is_a_change_of_what_runs_not_of_an_annotation() -> None:
    pytest.importorskip("cosmic_ray", reason="the extra `benchmarks` is not installed")
    found = list(places([Path("probe/planning/press_direction.py")]))
    source = (ROOT / "probe/planning/press_direction.py").read_text("utf-8").splitlines()
    assert found
    assert not [p for p in found if "->" in source[p.line - 1] and "BitOr" in p.operator]
