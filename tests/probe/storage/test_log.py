"""The write-ahead log beside a run: that it is seen when it comes, and what is no log."""

import struct
from pathlib import Path
from typing import Any

import pytest

from probe.config.rig import Rig
from probe.scan.session import scan
from probe.storage.log import unreadable_frames
from probe.storage.run import open_run


def test_a_log_that_comes_between_two_looks_is_looked_for_again(
    tmp_path: Path, winkler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a scan that begins just then makes one: the first connection knows nothing of it."""
    one_station = Rig.model_validate({"scan": {"start_mm": 32, "stations": 1, "hold_s": 0.2}})
    path = scan(one_station, "TIHA", tmp_path, seed=2, respond=winkler).path

    def looks(until: int) -> int:
        """How often it is looked when a log is there after so many looks."""
        looked: list[int] = []

        def state(_: Path) -> tuple[tuple[int, int], bool]:
            looked.append(1)
            return (0, 0), len(looked) > until

        monkeypatch.setattr("probe.storage.reader._state", state)
        assert open_run(path).finish == "completed"
        return len(looked)

    assert looks(1) == looks(0) + 2


@pytest.mark.parametrize("page_size", [0, 511, 768, 131_072])
def test_a_log_whose_pages_no_sqlite_has_is_unreadable(page_size: int, tmp_path: Path) -> None:
    log = tmp_path / "x.run-wal"
    log.write_bytes(struct.pack(">3I", 0x377F0682, 3007000, page_size) + bytes(20 + 24 + 512))
    assert unreadable_frames(log) == 1
