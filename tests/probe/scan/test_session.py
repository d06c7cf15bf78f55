"""A scan from Python: which time it runs on, and what it hands to whoever called."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers import ConfigError, SimulatedClock, WallClock
from probe.checks.dry_run import dry_run
from probe.config.rig import Rig
from probe.core.errors import StoreError
from probe.core.events import Event, Finish, StationStarted
from probe.guards.commands import Control
from probe.scan.resume import resume
from probe.scan.session import clock_for, resolve_rig, scan
from sim_backend.phantom.devices import VirtualStage

REAL_CELL = {"driver": "ft300", "port": "/dev/null"}


@pytest.mark.parametrize("tables, real_time, clock", [
    ({}, False, SimulatedClock),
    ({}, True, WallClock),
    ({"sensor": [REAL_CELL]}, False, WallClock),
    ({"stage": {"driver": "grbl", "port": "/dev/null"}}, False, WallClock),
])  # fmt: skip
def test_a_device_that_is_real_has_the_time_it_takes(
    tables: dict[str, Any], real_time: bool, clock: type
) -> None:
    assert isinstance(clock_for(Rig.model_validate(tables), real_time=real_time), clock)


@pytest.mark.parametrize("labels", [{"operator": "bad\udcff"}, {"bad\udcff": "x"}])
def test_labels_that_no_run_can_hold_are_refused_before_anything_opens(
    labels: dict[str, str], tmp_path: Path, winkler: Any
) -> None:
    with pytest.raises(
        ConfigError, match=r"^labels.* = 'bad\\udcff': holds bytes that are not UTF-8"
    ):
        scan(None, "TI", tmp_path / "runs", labels=labels, respond=winkler)
    assert not (tmp_path / "runs").exists()


@pytest.fixture
def free_bytes(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Lets disks have so much room."""

    def have(free: int) -> None:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(1, 0, free))

    return have


def test_a_scan_without_room_for_its_run_is_refused_as_by_a_dry_run(
    tmp_path: Path, winkler: Any, free_bytes: Callable[[int], None]
) -> None:
    free_bytes(700_000)
    report = dry_run(*resolve_rig(None, "TIHA"), tmp_path, winkler)
    checks = {one.name: one for one in report.checks}
    assert checks["disk"].level == "fault" and " MB, " in checks["disk"].text
    assert f"{tmp_path} has 0.7 MB; make room there" in checks["disk"].text
    with pytest.raises(StoreError) as said:
        scan(None, "TIHA", tmp_path, respond=winkler)
    assert str(said.value) == f"disk: {checks['disk'].text}"
    assert not list(tmp_path.iterdir())


def test_a_scan_without_room_leaves_no_folder_and_no_device_open(
    tmp_path: Path, winkler: Any, free_bytes: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    free_bytes(700_000)
    closed: list[str] = []
    monkeypatch.setattr(VirtualStage, "close", lambda stage: closed.append(stage.name))
    with pytest.raises(StoreError, match=rf"^disk: needs .*, {tmp_path} has 0\.7 MB"):
        scan(None, "TIHA", tmp_path / "not" / "yet", respond=winkler)
    assert not list(tmp_path.iterdir())
    assert closed == ["virtual"]


def _is_broken(_: object) -> Any:
    raise OSError(5, "Input/output error")


def _is_empty(_: object) -> Any:
    return shutil._ntuple_diskusage(0, 0, 0)


@pytest.mark.parametrize("asked, answer, why", [
    ("shutil.disk_usage", _is_broken, "Input/output error"),
    ("shutil.disk_usage", _is_empty, "it says that it is 0 bytes large"),
    ("pathlib.Path.exists", _is_broken, "Input/output error"),
])  # fmt: skip
def test_a_disk_that_does_not_say_its_room_is_warned_of_and_stops_no_scan(
    asked: str, answer: Any, why: str, tmp_path: Path, winkler: Any, monkeypatch: Any
) -> None:
    rig, control = Rig.model_validate({"scan": {"stations": 1, "hold_s": 0.1}}), Control()
    control.abort()
    there = Path.exists
    here = asked.endswith("usage")
    monkeypatch.setattr(asked, lambda p: answer(p) if here or p == tmp_path else there(p))
    checks = dry_run(*resolve_rig(rig, "TI"), tmp_path, winkler).checks
    (disk,) = (one for one in checks if one.name == "disk")
    said = f"; the room on {tmp_path} is not known ({why}): see that 2 times what it needs"
    assert (disk.level, said in disk.text) == ("warning", True), disk.text
    begun = scan(rig, "TI", tmp_path, control=control, respond=winkler)
    assert resume(begun, respond=winkler).ended.finish is Finish.COMPLETED


def test_a_run_goes_on_where_there_is_room_for_the_stations_it_lacks(
    tmp_path: Path, winkler: Any, free_bytes: Callable[[int], None]
) -> None:
    rig, control = Rig.model_validate({"scan": {"start_mm": 24.0, "stations": 9}}), Control()

    def impatient(event: Event) -> None:
        if isinstance(event, StationStarted) and event.station == 8:
            control.abort()

    path = scan(rig, "TI", tmp_path, control=control, observers=[impatient], respond=winkler).path
    before = path.read_bytes()
    free_bytes(100_000)
    with pytest.raises(StoreError, match=r"^disk: needs 0\.1 MB, .* has 0\.1 MB; make room there"):
        resume(path, respond=winkler)
    assert path.read_bytes() == before
    free_bytes(300_000)  # a whole scan needs 0.8
    assert resume(path, respond=winkler).ended.finish is Finish.COMPLETED


def test_real_devices_need_no_scene() -> None:
    rig = Rig.model_validate({"sensor": [REAL_CELL]})
    assert resolve_rig(rig, None) == (rig, None)


def test_who_called_is_shown_what_went_wrong(tmp_path: Path, winkler: Any) -> None:
    def viewer(_event: Event) -> None:
        raise ValueError("no display")

    rig = Rig.model_validate({"scan": {"stations": 1, "hold_s": 0.1}})
    done = scan(rig, "TI", tmp_path, observers=[viewer], respond=winkler)
    assert "observer: ValueError: no display" in done.notes


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, winkler: Any) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match=r"file/runs: no folder for runs can be made there"):
        scan(None, "TI", tmp_path / "file" / "runs", respond=winkler)
