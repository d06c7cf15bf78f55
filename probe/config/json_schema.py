"""JSON schemas of the files that people write, so that editors complete and check them.

A rig's devices have the keys of their drivers: one branch for each driver that is installed.
"""

import ast
import inspect
from itertools import pairwise
from typing import Any

from drivers import ConfigError, available, settings_of
from drivers.core.key_descriptions import description
from drivers.core.registry import Kind
from probe.config import rig
from sim_backend.scene.scene_file import Scene

DIALECT = "https://json-schema.org/draft/2020-12/schema"
TABLES: dict[Kind, str] = {"stages": "stage", "sensors": "sensor"}
GIVEN = ("phantom", "follow")
"""What a scan itself gives the simulated devices."""


def scene_schema() -> dict[str, Any]:
    """The schema of a scene file."""
    return {"$schema": DIALECT, **_untitled(Scene.model_json_schema())}


def rig_schema() -> dict[str, Any]:
    """The schema of a rig file, with the keys of every driver that is installed here."""
    schema = rig.Rig.model_json_schema()
    _describe({"Rig": schema, **schema["$defs"]})
    defs = schema["$defs"]
    common = defs.pop("Device")
    for kind, table in TABLES.items():
        branches = []
        for name in available(kind):
            try:
                keys = settings_of(kind, name, GIVEN).model_json_schema()
            except ConfigError as error:  # a driver of others that does not load
                keys = {"properties": {}, "additionalProperties": True, "description": str(error)}
            for own in (keys, *keys.get("$defs", {}).values()):
                _say(name, own["properties"])
            defs.update(keys.pop("$defs", {}))
            keys["properties"] |= {
                **common["properties"],
                "driver": {"const": name, "description": _first_line(keys)},
            }
            keys["required"] = ["driver", *keys.get("required", ())]
            keys.setdefault("additionalProperties", False)
            defs[f"{table}_{name}"] = keys
            branches.append(
                {
                    "if": {"properties": {"driver": {"const": name}}},
                    "then": {"$ref": f"#/$defs/{table}_{name}"},
                }
            )
        names = {"enum": available(kind), "description": "What stands there."}
        defs[f"{table}_device"] = {
            "type": "object",
            "properties": {"driver": names},
            "required": ["driver"],
            "allOf": branches,
        }
    properties = schema["properties"]
    said = {key: properties[key]["description"] for key in ("stage", "sensor")}
    properties["stage"] = {"$ref": "#/$defs/stage_device", "description": said["stage"]}
    properties["sensor"] = {
        "description": said["sensor"],
        "type": "array",
        "minItems": 1,
        "items": {"$ref": "#/$defs/sensor_device"},
    }
    return {"$schema": DIALECT, **_untitled(schema)}


def _describe(tables: dict[str, Any]) -> None:
    """Add to each key what `probe.config.rig` says below it.

    (Not pydantic's use_attribute_docstrings, which reads the source at every start.)
    """
    for table in ast.parse(inspect.getsource(rig)).body:
        if not (isinstance(table, ast.ClassDef) and table.name in tables):
            continue
        for pair in pairwise(table.body):
            match pair:
                case (
                    ast.AnnAssign(target=ast.Name(id=key)),
                    ast.Expr(value=ast.Constant(value=str(words))),
                ):
                    keys = tables[table.name]["properties"]
                    described = {**keys[key], "description": inspect.cleandoc(words)}
                    keys[key] = dict(sorted(described.items()))  # as pydantic has them


def _say(driver: str, keys: dict[str, Any]) -> None:
    """Describe a driver's keys where it does not do so itself."""
    for key, value in keys.items():
        if words := value.get("description") or description(driver, key):
            keys[key] = {**value, "description": words}


def _first_line(keys: dict[str, Any]) -> str:
    return str(keys.pop("description", "")).partition("\n\n")[0].replace("\n", " ")


def _untitled(value: Any) -> Any:
    """Without the titles that pydantic makes of the keys: they only repeat them."""
    if isinstance(value, dict):
        return {
            k: _untitled(v) for k, v in value.items() if not (k == "title" and isinstance(v, str))
        }
    if isinstance(value, list):
        return [_untitled(one) for one in value]
    return value
