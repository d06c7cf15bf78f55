"""Drivers of others that are wrong: each is named with what is wrong, and all else works."""

from pathlib import Path
from typing import Any

import pytest
from rig_files import rig_file

MODULE = """
from drivers import Channel
from drivers.core.reader import LineSensor

number = 3
"""


def installed(folder: Path, monkeypatch: pytest.MonkeyPatch, points: str, **modules: str) -> None:
    """A package with these entry points and modules, as pip would leave it."""
    info = folder / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(points)
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(folder))


def rig_with(driver: str, folder: Path) -> Path:
    """A rig file whose only sensor is of this driver, over a virtual stage."""
    file = rig_file(folder, stations=1)
    stage, sensor = file.read_text().split("[[sensor]]")
    file.write_text(f"face_mm2 = 100.0\n{stage}[[sensor]]{sensor.replace('virtual', driver)}")
    return file


BROKEN = {
    "their-none": ("theirs:missing", "module 'theirs' has no attribute 'missing'"),
    "their-number": ("theirs:number", "3 is not a callable object"),
    "their-error": ("theirs_raises:sensor", "RuntimeError: boom at import"),
}


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package whose entry points lead nowhere."""
    points = "[palpate.sensors]\n" + "".join(f"{n} = {at}\n" for n, (at, _) in BROKEN.items())
    raises = 'raise RuntimeError("boom at import")\n'
    installed(tmp_path, monkeypatch, points, theirs=MODULE, theirs_raises=raises)


@pytest.mark.usefixtures("broken")
def test_broken_plug_ins_are_named_and_all_else_works(palpate: Any) -> None:
    found = palpate("doctor", "--json", status=0)
    checks = {c["name"]: (c["level"], c["text"]) for c in found.json["checks"]}
    for name, (_, why) in BROKEN.items():
        level, text = checks[f"sensors: {name}"]
        assert level == "warning"
        assert why in text
    assert checks["sensors: ft300"][0] == "ok"
    schema = palpate("schema", "rig", status=0)
    assert "sensor_ft300" in schema.json["$defs"]


@pytest.mark.usefixtures("broken")
@pytest.mark.parametrize("driver", BROKEN)
@pytest.mark.parametrize("how", [("--dry-run",), ()])
def test_a_rig_that_names_a_broken_plug_in_is_refused(
    palpate: Any, tmp_path: Path, driver: str, how: tuple[str, ...]
) -> None:
    ran = palpate("scan", rig_with(driver, tmp_path), "--out", tmp_path / "runs", *how, status=2)
    assert BROKEN[driver][1] in ran.out + ran.err
    assert "sensor[0]" in ran.out + ran.err


MISTAKEN = """
from drivers import Channel
from drivers.core.reader import LineSensor

def raises(clock):
    raise ValueError("no such mode")

def nothing(clock):
    return None

def unknown(clock):
    channel = Channel("force", "N", role="Force")
    return LineSensor(clock, "unknown", (channel,), 100.0, lambda: None)

def opens(clock):
    def source():
        raise ValueError("no such mode")
    return LineSensor(clock, "opens", (Channel("force", "N", "force"),), 100.0, source)
"""
MISTAKES = {
    "raises": "raises: driver: ValueError: no such mode",
    "nothing": "nothing: driver: its factory returned None, and not a Sensor",
    "unknown": "unknown: driver: channel 'force' has the role 'Force'; allowed: force, pressure, ",
    "opens": "opens: driver: ValueError: no such mode",
}


@pytest.fixture
def mistaken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package whose factories make no sensor, or one that cannot be connected."""
    points = "[palpate.sensors]\n" + "".join(f"{n} = mistaken:{n}\n" for n in MISTAKES)
    installed(tmp_path, monkeypatch, points, mistaken=MISTAKEN)


@pytest.mark.usefixtures("mistaken")
@pytest.mark.parametrize("driver", MISTAKES)
def test_a_drivers_mistake_is_its_devices_fault(palpate: Any, tmp_path: Path, driver: str) -> None:
    rig = rig_with(driver, tmp_path)
    for command in (("watch", rig, "--seconds", "1"), ("scan", rig, "--out", tmp_path / "runs")):
        ran = palpate(*command)
        assert (ran.status, MISTAKES[driver] in ran.err) == (3, True), ran.err
    if driver != "opens":  # nothing is opened
        dry = palpate("scan", rig, "--dry-run")
        assert (dry.status, MISTAKES[driver] in dry.out) == (2, True), dry.out


GAUGES = """
from drivers import Channel
from drivers.core.reader import LineSensor

def plain(clock):
    return LineSensor(clock, "gauge", (Channel("force", "N", "force"),), 100.0, lambda: None)

def stated(clock, *, noise_mn: float | None = None):
    return plain(clock)
"""


@pytest.mark.usefixtures("springs")
@pytest.mark.parametrize(("driver", "takes"), [("plain", False), ("stated", True)])
def test_a_key_is_advised_where_the_driver_takes_it(
    palpate: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, driver: str, takes: bool
) -> None:
    points = "[palpate.sensors]\nplain = gauges:plain\nstated = gauges:stated\n"
    installed(tmp_path, monkeypatch, points, gauges=GAUGES)
    rig = rig_with(driver, tmp_path)
    rig.write_text(rig.read_text().replace('"TI"', '"TIHA"'))
    dry = palpate("scan", rig, "--dry-run", "--json")
    (said,) = [c["text"] for c in dry.json["checks"] if c["name"] == f"pulse on {driver}"]
    assert ("give noise_mn" in said) is takes
    assert ("palpate doctor" in said) is not takes
    rig.write_text(rig.read_text().replace("[scan]", "noise_mn = 1.0\n[scan]"))
    assert (palpate("scan", rig, "--dry-run").status == 0) is takes
