"""Every recorded device, replayed byte by byte, is understood as it was when recorded."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from emulated_devices import ARRAY, PRINTED, REGISTER
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import ConfigError, WallClock
from drivers.testing.exchange import Exchange, Replay, load, replay, save
from drivers.testing.record import exercise, record
from sim_backend import load_scene
from sim_backend.emulators import ft300, grbl, lines, modbus, taxels
from sim_backend.phantom.phantom import Phantom, Respond

PATIENT = {"stages": {"silent_s": 5.0}}
"""A process of tests may stand still, and whoever emulates a device in it with it."""
EXCHANGES = sorted((Path(__file__).parents[1] / "exchanges").glob("*.toml"))


def test_every_kind_of_line_was_recorded() -> None:
    recorded = {load(path).driver for path in EXCHANGES}
    assert recorded == {"ft300", "grbl", "lines", "modbus", "taxels"}


@pytest.mark.parametrize("path", EXCHANGES, ids=lambda path: path.stem)
def test_a_recorded_device_is_understood_as_then(path: Path) -> None:
    exchange = load(path)
    with replay(exchange) as device:
        place: dict[str, Any] = {"port": device.address, **PATIENT.get(exchange.kind, {})}
        if "host" in exchange.settings:
            place = {"host": "127.0.0.1", "tcp_port": device.port}
        rows = exercise(
            exchange.kind, exchange.driver, {**exchange.settings, **place}, 0.4, exchange.move_m
        )
        assert device.unexpected == b"", "the driver says what the device was never told"
    assert rows
    if exchange.kind == "stages":
        assert rows == exchange.rows
    else:
        assert overlap(rows, exchange.rows) >= 3


Rows = tuple[tuple[float, ...], ...]


def overlap(a: Rows, b: Rows) -> int:
    """Readings in common, if one goes on where the other left off; both are part of one stream."""
    spans = (
        (a[max(shift, 0) : len(b) + shift], b[max(-shift, 0) : len(a) - shift])
        for shift in range(-len(b) + 1, len(a))
    )
    return max(len(x) for x, y in spans if x == y)


EMULATED: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "grbl": (partial(grbl.emulate, homed=True), {"origin_mm": grbl.ORIGIN_MM}),
    "ft300": (ft300.emulate, {}),
    "lines": (lines.emulate, PRINTED),
    "modbus": (modbus.emulate, {"register": [REGISTER]}),
    "taxels": (taxels.emulate, ARRAY),
}


@pytest.mark.parametrize("name", EMULATED)
def test_a_device_can_be_recorded_and_replayed(name: str, winkler: Respond, tmp_path: Path) -> None:
    emulate, keys = EMULATED[name]
    phantom = Phantom(load_scene("TIHA"), WallClock(), winkler, home=(0.032, 0.0, -0.001))
    kind = "stages" if name == "grbl" else "sensors"
    with emulate(phantom, at=str(tmp_path / "tty")) as served:
        found = record(
            kind, name, {"port": served.address, **PATIENT.get(kind, {}), **keys},
            seconds=0.3, move_mm=1.0, device=f"emulated {name}",
        )  # fmt: skip
    save(found, tmp_path / "found.toml")
    again = load(tmp_path / "found.toml")
    assert (again.pairs, again.rows) == (found.pairs, found.rows)
    assert any(received for _, received in found.pairs)
    test_a_recorded_device_is_understood_as_then(tmp_path / "found.toml")


@settings(max_examples=50)
@given(st.lists(st.tuples(st.binary(max_size=20), st.binary(max_size=20)), max_size=5))
def test_any_bytes_survive_the_file(pairs: list[tuple[bytes, bytes]]) -> None:
    import tempfile

    exchange = Exchange("sensors", "lines", {"a": [1, {"b": "c"}]}, "d", "now", tuple(pairs))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.toml"
        save(exchange, path)
        assert load(path).pairs == exchange.pairs


def test_a_driver_that_says_something_else_is_found_out() -> None:
    pairs = ((b"?", b"1"), (b"?", b"2"), (b"go\n", b"ok"), (b"?", b"3"))
    device = Replay(Exchange("stages", "x", {}, "", "", pairs))
    assert [device.answer(s) for s in (b"?", b"go\n", b"?", b"?")] == [b"1", b"ok", b"3", b"3"]
    assert device.answer(b"gone\n") is None
    device.close()


def test_a_file_that_is_none_is_reported(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("pairs = 3")
    with pytest.raises(ConfigError, match="not an exchange file"):
        load(tmp_path / "a.toml")
