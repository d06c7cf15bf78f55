"""Shipped files with something odd in them: the JSON schema marks them where palpate refuses them.

What only palpate can know is left to it: one key against another, and infinite numbers, which JSON
does not have.
"""

import copy
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from paths import ROOT
from pydantic import BaseModel, ValidationError

from drivers import ConfigError
from drivers.core.registry import settings_of
from probe.config.json_schema import rig_schema, scene_schema
from probe.config.rig import Device, Rig
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import Scene

BUILTIN = ROOT / "sim_backend" / "scene" / "builtin"
RIGS = [tomllib.loads(f.read_text("utf-8")) for f in sorted((ROOT / "rigs").glob("*.toml"))]
SCENES = [tomllib.loads(f.read_text("utf-8")) for f in sorted(BUILTIN.glob("*.toml"))]
RIG_MARKS = Draft202012Validator(rig_schema())
SCENE_MARKS = Draft202012Validator(scene_schema())
ODD: list[Any] = [
    0, -1, 3, 2.5, -0.5, 1e9, True, False, "", "x", "4.0", "virtual", "ur", "cylinder", [], {},
    [1.0], [1.0, 2.0], [1, True], [1.0, "2", 3.0], [[1.0, 2.0]], {"x": [0, 1]}, [{"name": "a"}],
]  # fmt: skip
KEYS = ["driver", "name", "kind", "shape", "nope", "x_mm", "port", "host", "rate_hz", "stations"]

Path = tuple[str | int, ...]


def places(table: Any, above: Path = ()) -> Iterator[Path]:
    """Every key and index in ``table``."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        yield (*above, key)
        if isinstance(value, dict | list):
            yield from places(value, (*above, key))


@st.composite
def odd(draw: st.DrawFn, files: list[dict[str, Any]]) -> dict[str, Any]:
    """One of ``files`` with one or two values changed, added or taken away."""
    found = copy.deepcopy(draw(st.sampled_from(files)))
    for _ in range(draw(st.integers(1, 2))):
        *above, last = draw(st.sampled_from(list(places(found))))
        table: Any = found
        for key in above:
            table = table[key]
        what = draw(st.sampled_from(["change", "remove", "add"]))
        if what == "remove":
            del table[last]
        elif what == "change":
            table[last] = copy.deepcopy(draw(st.sampled_from(ODD)))
        elif isinstance(table, dict):
            table[draw(st.sampled_from(KEYS))] = copy.deepcopy(draw(st.sampled_from(ODD)))
        if not found:
            break
    return found


def refusals(model: type[BaseModel], table: Any) -> list[str]:
    """The kinds of pydantic's errors."""
    try:
        model.model_validate(table)
    except ValidationError as error:
        return [fault["type"] for fault in error.errors()]
    return []


def refusals_of_devices(file: dict[str, Any]) -> list[str]:
    found = []
    sensors = file.get("sensor", [])
    given = [("stages", file.get("stage", {})), *(("sensors", one) for one in sensors)]
    for kind, table in given:
        if table:
            keys = {k: v for k, v in table.items() if k not in Device.model_fields}
            if table["driver"] == "virtual":
                keys["phantom"] = object.__new__(Phantom)  # which a scan gives it
            try:
                found += refusals(settings_of(kind, table["driver"]), keys)
            except ConfigError:
                found.append("no such driver")
    return found


def differ(marks: Draft202012Validator, file: dict[str, Any], found: list[str]) -> str:
    """Where only one of the two refuses a file: who, and why; empty where both agree."""
    marked = [error.message for error in marks.iter_errors(file)]
    if marked:
        return "" if found else f"only the schema refuses it: {marked}"
    return "" if set(found) <= {"value_error"} else f"only palpate refuses it: {found}"


@given(odd(RIGS))
@settings(max_examples=100, deadline=None)
def test_of_rigs(file: dict[str, Any]) -> None:
    found = refusals(Rig, file)
    assert not differ(RIG_MARKS, file, found or refusals_of_devices(file))


@given(odd(SCENES))
@settings(max_examples=100, deadline=None)
def test_of_scenes(file: dict[str, Any]) -> None:
    assert not differ(SCENE_MARKS, file, refusals(Scene, file))


@pytest.mark.parametrize("table, key, words", [
    ({"scan": {"start_mm": True}}, ("scan", "start_mm"), "a number"),
    ({"scan": {"stations": "3"}}, ("scan", "stations"), "a number, without quotes"),
    ({"safety": {"workspace_mm": {"x": [True, 9.0]}}}, ("safety", "workspace_mm", "x", 0), ""),
], ids=["switch", "text", "in a list"])  # fmt: skip
def test_what_is_of_another_kind_is_named_by_its_key(
    table: dict[str, Any], key: Path, words: str
) -> None:
    with pytest.raises(ValidationError) as said:
        Rig.model_validate(table)
    (fault,) = said.value.errors()
    assert fault["loc"] == key
    assert fault["msg"].startswith(f"Input should be {words}")
