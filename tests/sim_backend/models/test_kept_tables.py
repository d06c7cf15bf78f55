"""A table that cannot be kept is still an answer."""

from pathlib import Path

import numpy as np

from sim_backend.models.kept_tables import kept_table


def test_a_table_is_not_lost_to_a_folder_that_takes_nothing(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file where the folder should be")
    made = {"force": np.array([1.0, np.nan])}
    found = kept_table(tmp_path / "cache" / "fast" / "a.npz", lambda: made)
    assert np.array_equal(found["force"], made["force"], equal_nan=True)


def test_a_full_disk_leaves_no_part_of_a_table(tmp_path: Path) -> None:
    """Here the name is taken by a folder, which no file can replace."""
    (tmp_path / "a.npz").mkdir()
    assert kept_table(tmp_path / "a.npz", lambda: {"x": np.ones(1)})["x"] == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]
