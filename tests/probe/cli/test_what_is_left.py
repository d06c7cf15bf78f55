"""What a scan says of its run at the end, once it has looked."""

import os
from pathlib import Path

from databases import opened
from small_runs import written

from probe.cli.scan import what_is_left


def test_what_was_read_is_where_it_was_looked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.run"
    written(path, 60).close()
    assert what_is_left(path) == f"What was read is in {path}"
    with opened(path) as other:
        other.execute("DELETE FROM event WHERE id > 40")
    assert f"40 events are left in {path}, which is damaged" in what_is_left(path)
    os.truncate(path, 0)
    assert what_is_left(path).startswith("What was read cannot be read now: ")
