"""One key of a rig changed for one scan: validated as the file is, and kept in the run."""

import tomllib
from collections.abc import Mapping
from typing import Any

from probe.config.load_rig import checked_rig
from probe.config.rig import Rig, RigError


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
    return checked_rig(raw, "; ".join(f"--set {key}={text}" for key, text in settings.items()))


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
