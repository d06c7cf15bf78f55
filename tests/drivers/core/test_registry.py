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


def with_a_methods_name(clock: Clock, *, copy: int = 1) -> Any:
    return SimpleNamespace(clock=clock, keys=copy)


@pytest.fixture(params=[with_model, with_keywords], ids=lambda factory: factory.__name__)
def driver(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    factory = request.param
    point = EntryPoint("mine", f"{__name__}:{factory.__name__}", "palpate.sensors")
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


@pytest.mark.parametrize("driver", [with_a_methods_name], indirect=True)
def test_a_keyword_may_be_called_as_a_method_of_the_model_is(driver: str) -> None:
    assert open_driver("sensors", driver, WallClock(), {"copy": 2}).keys == 2


@pytest.mark.parametrize("kind, driver, keys", [
    ("sensors", "lines", {"rate_hz": 0.0}),
    ("sensors", "lines", {"time_unit_s": -1.0}),
    ("sensors", "lines", {"latency_ms": -50.0}),
    ("sensors", "taxels", {"baud": -3}),
    ("sensors", "taxels", {"latency_ms": -50.0}),
    ("sensors", "lsl", {"latency_ms": -50.0}),
    ("sensors", "virtual", {"noise_mn": -1.0}),
    ("stages", "virtual", {"stiffness_n_mm": 0.0}),
    ("stages", "standa", {"steps_per_mm": [400.0, -1.0, 400.0]}),
    ("stages", "ur", {"frequency_hz": 1000.0}),
    ("stages", "ur", {"frequency_hz": 0.0}),
    ("stages", "ur", {"max_speed_mm_s": -1.0}),
    ("sensors", "modbus", {"rate_hz": 0.0}),
])  # fmt: skip
def test_numbers_that_no_device_has_are_refused(
    kind: registry.Kind, driver: str, keys: dict[str, Any]
) -> None:
    with pytest.raises(ValidationError) as reported:
        open_driver(kind, driver, WallClock(), keys)
    assert {*keys} <= {error["loc"][0] for error in reported.value.errors()}


def test_an_unknown_driver_names_the_known() -> None:
    with pytest.raises(ConfigError, match="known: ft300"):
        open_driver("sensors", "nothing", WallClock(), {})
