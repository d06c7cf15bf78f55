"""The contract of every driver as a pytest plugin: ``pytest --palpate-driver=NAME``.

NAME is registered under ``palpate.stages`` or ``palpate.sensors``, by this package or any other.
The device's settings come from ``--palpate-rig FILE`` (a rig file that uses the driver) or from
``--palpate-bench module:function``, a context manager that gives a `Bench`, such as an emulator
that can be unplugged. The tests themselves are in `drivers.testing.contract_tests`.

The stage moves a few millimetres up and back (+z) from where it is: there must be room.
"""

import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from drivers.core.clocks import WallClock
from drivers.core.protocols import Sensor, Stage
from drivers.core.registry import Kind, available, open_driver, settings_of

pytest.register_assert_rewrite("drivers.testing.contract_tests")
TESTS = Path(__file__).with_name("contract_tests.py")
BEGAN_S = 3600.0
"""The scan began an hour ago: seconds that a device counts since it was made are not the scan's."""


@dataclass(frozen=True)
class Bench:
    """A device on the table.

    ``settings``: the keys of its table in a rig file. ``unplug`` and ``replug`` pull and put back
    its plug; without them what needs them is skipped. ``travel_mm``: room above the probe.
    ``connected``: False for what needs no connection and so cannot lose it.
    """

    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    unplug: Callable[[], None] | None = None
    replug: Callable[[], None] | None = None
    travel_mm: float = 4.0
    speed_mm_s: float = 8.0
    connected: bool = True
    clock: WallClock = field(default_factory=partial(WallClock, BEGAN_S))

    def open_stage(self) -> Stage:
        """The stage, not yet connected."""
        stage: Stage = self._make("stages")
        return stage

    def open_sensor(self) -> Sensor:
        """The sensor, not yet connected."""
        sensor: Sensor = self._make("sensors")
        return sensor

    def _make(self, kind: Kind) -> Any:
        if self.name not in available(kind):
            pytest.skip(f"{self.name} is not registered under palpate.{kind}")
        return open_driver(kind, self.name, self.clock, self.settings)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options of ``pytest``."""
    group = parser.getgroup("palpate", "the contract of a palpate driver")
    group.addoption("--palpate-driver", metavar="NAME", help="run the driver contract on NAME")
    group.addoption("--palpate-rig", metavar="FILE", help="take its settings from a rig file")
    group.addoption(
        "--palpate-bench", metavar="MODULE:FUNCTION", help="a context manager giving a Bench"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Run the contract, and nothing else unless more was asked for."""
    name = config.getoption("--palpate-driver")
    if name is None:
        return
    if name not in (known := sorted({*available("stages"), *available("sensors")})):
        raise pytest.UsageError(f"--palpate-driver={name}: known drivers: {', '.join(known)}")
    asked = config.args_source is pytest.Config.ArgsSource.ARGS
    config.args[:] = [*(config.args if asked else []), str(TESTS)]


@pytest.fixture
def palpate_bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """The device under test; a package may override this fixture instead of giving options."""
    name = request.config.getoption("--palpate-driver")
    where = request.config.getoption("--palpate-bench")
    with nullcontext(_from_rig(request.config, name)) if where is None else _named(where) as bench:
        yield bench


def _named(where: str) -> AbstractContextManager[Bench]:
    module, _, function = where.partition(":")
    made: AbstractContextManager[Bench] = getattr(import_module(module), function)()
    return made


def _needed(name: str) -> list[str]:
    """The keys without which a driver cannot be opened."""
    kinds: tuple[Kind, ...] = ("stages", "sensors")
    models = [settings_of(kind, name) for kind in kinds if name in available(kind)]
    return sorted({k for one in models for k, f in one.model_fields.items() if f.is_required()})


def _from_rig(config: pytest.Config, name: str) -> Bench:
    file = config.getoption("--palpate-rig")
    if file is None:
        if needed := _needed(name):
            raise pytest.UsageError(
                f"{name!r} needs {', '.join(needed)}: give --palpate-rig RIG.toml with its table, "
                "or --palpate-bench MODULE:FUNCTION with an emulator"
            )
        return Bench(name)
    rig = tomllib.loads(Path(file).read_text(encoding="utf-8"))
    tables = [rig.get("stage", {}), *rig.get("sensor", [])]
    for table in tables:
        if table.get("driver") == name:
            keys = {k: v for k, v in table.items() if k not in ("driver", "fallback")}
            return Bench(name, keys)
    raise pytest.UsageError(f"--palpate-rig {file}: no [stage] or [[sensor]] has driver {name!r}")
