"""A run's settings without what says who, where and when."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from probe.core.events import RunStarted

TELLING = ("labels", "host", "port", "file", "imported")
"""Keys whose values may name a person, a place or a machine; so may every ``*_uri``."""


def anonymous(started: RunStarted) -> RunStarted:
    """Without labels, files, addresses and the date."""
    config: dict[str, Any] = _without(started.config)
    return replace(started, started_utc="", config=config)


def _without(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {
            key: _without(one)
            for key, one in value.items()
            if key not in TELLING and not str(key).endswith("_uri")
        }
    if isinstance(value, list | tuple):
        return [_without(one) for one in value]
    return value
