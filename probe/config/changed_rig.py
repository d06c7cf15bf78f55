"""One key of a rig changed for one scan: validated as the file is, and kept in the run."""

import tomllib
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from drivers import ConfigError
from probe.config.rig import Rig, RigError
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.config.scan_planner import planner_for
from sim_backend.scene.explain import explain


def changed(rig: Rig, settings: Mapping[str, str]) -> Rig:
    """``rig`` with each key of ``settings``, such as ``scan.pitch_mm`` or ``sensor.0.rate_hz``.

    A value is written as in the file; text needs no quotation marks. Raises `RigError`.
    """
    if not settings:
        return rig
    raw = rig.model_dump(mode="json")
    for key, text in settings.items():
        *tables, last = key.split(".")
        at: Any = raw
        for name in tables:
            at = _entry(at, name, key)
        if isinstance(at, list):
            raise RigError(f"--set {key}: say which entry and which of its keys: {key}.KEY")
        if not isinstance(at, dict):
            raise RigError(f"--set {key}: {'.'.join(tables)} is no table of keys")
        at[last] = _value(text)
    said = "; ".join(f"--set {key}={text}" for key, text in settings.items())
    try:
        new = Rig.model_validate(raw)
        plan = plan_for(new)
        limits_for(new, plan)
        planner_for(new, plan)
    except ValidationError as error:
        raise RigError("\n".join(f"{said}: {line}" for line in explain(error, Rig))) from None
    except (RigError, ConfigError) as error:
        raise RigError(f"{said}: {error}") from None
    return new


def _entry(at: Any, name: str, key: str) -> Any:
    """A table within a table, or one of a list by its number."""
    if isinstance(at, list):
        if name.isdigit() and int(name) < len(at):
            return at[int(name)]
        raise RigError(f"--set {key}: {name} is none of the entries 0 to {len(at) - 1}")
    if not isinstance(at, dict) or name not in at or at[name] is None:
        known = ", ".join(at) if isinstance(at, dict) else "none"
        raise RigError(f"--set {key}: there is no table {name!r}; there are: {known}")
    return at[name]


def _value(text: str) -> Any:
    """As TOML reads it, or the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
