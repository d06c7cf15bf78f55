"""A scan from Python: which time it runs on, and what it hands to whoever called."""

from pathlib import Path
from typing import Any

import pytest

from drivers import ConfigError, SimulatedClock, WallClock
from probe.acquisition.session import clock_for, resolve_rig, scan
from probe.config.rig import Rig
from probe.core.errors import StoreError
from probe.core.events import Event

REAL_CELL = {"driver": "ft300", "port": "/dev/null"}


@pytest.mark.parametrize(
    ("tables", "real_time", "clock"),
    [
        ({}, False, SimulatedClock),
        ({}, True, WallClock),
        ({"sensor": [REAL_CELL]}, False, WallClock),
        ({"stage": {"driver": "grbl", "port": "/dev/null"}}, False, WallClock),
    ],
)
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
