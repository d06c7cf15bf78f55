"""``palpate init`` writes what works as written; ``palpate schema`` marks what palpate refuses."""

import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from paths import ROOT
from programs import python

from probe.cli.files import schema_text
from probe.config.json_schema import rig_schema, scene_schema
from probe.config.load_rig import load_rig
from probe.config.rig import RigError
from sim_backend.scene.scene_file import SceneError, load_scene

SCENES = ROOT / "sim_backend" / "scene" / "builtin"
SHIPPED = [*sorted((ROOT / "rigs").glob("*.toml")), *sorted(SCENES.glob("*.toml"))]
SCHEMAS = {"rig": ROOT / "rigs" / "rig.schema.json", "scene": SCENES / "scene.schema.json"}
BAD_RIGS = [
    ("scan.pitch", "[scan]\npitch = 4.0\n"),
    ("scan.indentation_mm", "[scan]\nindentation_mm = -1.0\n"),
    ("scan.stations", "[scan]\nstations = 'many'\n"),
    ("safety.max_force", "[safety]\nmax_force = 3.0\n"),
    ("safety.workspace_mm.x", "[safety]\nworkspace_mm = { x = [1.0] }\n"),
    ("scenes", "[scenes]\nname = 'TI'\n"),
    ("sensor.0.driver", "[[sensor]]\nrate_hz = 100.0\n"),
]


def complaints(schema: dict[str, Any], text: str) -> list[str]:
    """The keys that a JSON-schema validator marks."""
    keys = []
    for error in Draft202012Validator(schema).iter_errors(tomllib.loads(text)):
        path = [str(part) for part in error.absolute_path]
        named = re.findall(r"'(\w+)' (?:was unexpected|is a required property)", error.message)
        keys += [".".join([*path, name]) for name in named] or [".".join(path)]
    return keys


@pytest.mark.parametrize("file", SHIPPED, ids=lambda p: p.name)
def test_every_shipped_file_names_a_schema_and_keeps_it(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    found = re.match(r"#:schema (\S+)\n", text)
    schema = json.loads((file.parent / found[1]).read_text(encoding="utf-8"))
    assert complaints(schema, text) == []


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_shipped_schema_is_that_of_the_models(kind: str) -> None:
    kept = SCHEMAS[kind].read_text(encoding="utf-8")
    assert kept == schema_text(kind), f"palpate schema {kind} > {SCHEMAS[kind]}"


@pytest.mark.parametrize(("key", "text"), BAD_RIGS, ids=lambda one: one.split("\n")[0])
def test_schema_and_palpate_name_the_same_key(key: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(RigError) as said:
        load_rig(file)
    assert f": {key}" in str(said.value)
    assert key in complaints(rig_schema(), text)


def test_the_keys_of_drivers_are_checked() -> None:
    marked = complaints(rig_schema(), '[stage]\ndriver = "ur"\nhots = "10.0.0.1"\n')
    assert marked == ["stage.hots"]
    sensor = '[[sensor]]\ndriver = "virtual"\nnoise_mn = "low"\n'
    assert complaints(rig_schema(), sensor) == ["sensor.0.noise_mn"]


def test_a_scene_with_a_typing_error_is_marked(tmp_path: Path) -> None:
    text = (SCENES / "TIHA.toml").read_text(encoding="utf-8").replace("wall_mm", "wall_m")
    file = tmp_path / "scene.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match=r"wall_m = .*did you mean wall_mm\?\); known here: "):
        load_scene(str(file))
    assert complaints(scene_schema(), text)


@pytest.mark.parametrize("kind", ["rig", "scene"])
def test_what_init_writes_passes_a_dry_run(kind: str, palpate: Any, tmp_path: Path) -> None:
    folder = tmp_path / "new"
    made = palpate("init", kind, folder, status=0)
    assert str(folder / f"{kind}.toml") in made.out
    text = (folder / f"{kind}.toml").read_text(encoding="utf-8")
    assert complaints(json.loads((folder / f"{kind}.schema.json").read_text()), text) == []
    which = [folder / "rig.toml"] if kind == "rig" else ["--scene", folder / "scene.toml"]
    palpate("scan", *which, "--dry-run", "--out", tmp_path, status=0)
    again = palpate("init", kind, folder, status=2)
    assert "exists" in again.err


def test_the_comments_in_the_rig_are_keys_that_work(palpate: Any, tmp_path: Path) -> None:
    palpate("init", "rig", tmp_path / "new")
    text = (tmp_path / "new" / "rig.toml").read_text(encoding="utf-8")
    grid = re.sub(r"^(start_mm|pitch_mm|stations) = [\d.]+$", "", text, flags=re.MULTILINE)
    grid = re.sub(r"^# (\w+ = )", r"\1", grid, flags=re.MULTILINE)
    grid = grid.replace('force = "force-ft300.json"', "")
    assert complaints(rig_schema(), grid) == []
    assert tomllib.loads(grid)["scan"]["stations"] == [9, 5]


@pytest.mark.slow
def test_the_driver_that_init_writes_keeps_the_contract(palpate: Any, tmp_path: Path) -> None:
    package = tmp_path / "mine"
    above = '[tool.pytest.ini_options]\naddopts = "--of-another-project"\n'
    (tmp_path / "pyproject.toml").write_text(above)
    assert palpate("init", "driver", package).status == 0
    groups = tomllib.loads((package / "pyproject.toml").read_text())["project"]["entry-points"]
    info = package / "mine-1.0.dist-info"  # as pip would leave it
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    lines = [f"[{g}]\n" + "".join(f"{n} = {p}\n" for n, p in e.items()) for g, e in groups.items()]
    (info / "entry_points.txt").write_text("\n".join(lines))
    path = f"{package}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    ran = python(
        "-m", "pytest", "-q", "-p", "no:cacheprovider", "--palpate-driver=my_gauge",
        "--palpate-bench=my_bench:bench", cwd=package, env=os.environ | {"PYTHONPATH": path},
        status=0,
    )  # fmt: skip
    assert re.search(r"[5-9] passed", ran.stdout), ran.stdout
