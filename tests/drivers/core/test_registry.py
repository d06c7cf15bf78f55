"""A driver is opened with keys that its own model has checked."""

from importlib.metadata import EntryPoint
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import ValidationError

from drivers import Clock, ConfigError, Settings, WallClock, open_driver, settings_of
from drivers.core import registry


class Keys(Settings):
    name: str = "mine"
    port: str
    rate_hz: float = 100.0


def with_model(clock: Clock, settings: Keys) -> Any:
    return SimpleNamespace(clock=clock, keys=settings)


def with_keywords(clock: Clock, *, port: str, rate_hz: float = 100.0) -> Any:
    return SimpleNamespace(clock=clock, keys=SimpleNamespace(port=port, rate_hz=rate_hz))


@pytest.fixture(params=["with_model", "with_keywords"])
def driver(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    point = EntryPoint("mine", f"{__name__}:{request.param}", "palpate.sensors")
    factory = globals()[request.param]
    monkeypatch.setattr(EntryPoint, "load", lambda _self: factory)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point] if group else [])
    return "mine"


def test_keys_are_checked_and_given(driver: str) -> None:
    made = open_driver("sensors", driver, WallClock(), {"port": "/dev/x", "rate_hz": 50})
    assert (made.keys.port, made.keys.rate_hz) == ("/dev/x", 50.0)


@pytest.mark.parametrize(
    ("keys", "named"),
    [({}, "port"), ({"port": "x", "rate_hz": "fast"}, "rate_hz"), ({"port": "x", "no": 1}, "no")],
)
def test_wrong_keys_are_named(driver: str, keys: dict[str, Any], named: str) -> None:
    with pytest.raises(ValidationError) as reported:
        open_driver("sensors", driver, WallClock(), keys)
    assert [error["loc"] for error in reported.value.errors()] == [(named,)]


def test_the_schema_is_the_models(driver: str) -> None:
    schema = settings_of("sensors", driver).model_json_schema()
    assert schema["properties"]["rate_hz"]["default"] == 100.0
    assert schema["required"] == ["port"]


def test_an_unknown_driver_names_the_known() -> None:
    with pytest.raises(ConfigError, match="known: ft300"):
        open_driver("sensors", "nothing", WallClock(), {})
