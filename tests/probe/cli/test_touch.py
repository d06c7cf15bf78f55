"""`palpate touch`: the tables there are, whether one knows a scene, and another one."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from sim_backend.touch import kept


def test_the_tables_are_listed_with_what_they_are_of(palpate: Callable) -> None:
    assert "cylinder on a sliding support, plane stress" in palpate("touch").out
    (about,) = json.loads(palpate("touch", "--json").out)["tables"].values()
    assert about["shape"] == "cylinder" and set(about["errors"]) == {"bare", "lump", "vessel"}


@pytest.mark.parametrize("changed, said", [
    ({}, "plane stress"),
    ({'plane = "stress"': 'plane = "strain"'}, "no touch table"),
    ({"height_mm = 16.83": "height_mm = 60.0"}, "other ones"),
])  # fmt: skip
def test_whether_a_table_knows_a_scene(
    changed: dict[str, str], said: str, tmp_path: Path, palpate: Callable
) -> None:
    text = palpate("scenes", "TIT").out
    for old, new in changed.items():
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / "scene.toml"
    file.write_text(text)
    assert said in palpate("touch", file).out
    assert json.loads(palpate("touch", file, "--json").out)["known"] is (not changed)


@pytest.mark.slow
def test_a_table_is_made_and_found_again(
    tmp_path: Path, palpate: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "KEPT", tmp_path / "kept")
    file = tmp_path / "scene.toml"
    file.write_text(palpate("scenes", "TI").out.replace('"stress"', '"strain"'))
    made = palpate("touch", file, "--make", "--presses", "20", "--workers", "2", "--json")
    said = json.loads(made.out)
    assert said["known"] and Path(said["kept"]).is_file()
    assert "plane strain" in palpate("touch", file).out
    kept.table_for.cache_clear()


@pytest.mark.parametrize("arguments, said", [
    (["--make"], "--make needs a scene"), (["HAOT"], "blocks of tissue"),
    (["TIT-solid"], "plane sections only"), (["none"], "neither a file nor"),
])  # fmt: skip
def test_what_has_no_table_is_said(arguments: list[str], said: str, palpate: Callable) -> None:
    done = palpate("touch", *arguments)
    assert done.status == 2 and said in done.err
