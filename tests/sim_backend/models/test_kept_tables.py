"""A table that cannot be kept is still an answer, and one that cannot be read is made anew."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sim_backend.models.kept_tables import kept_table

MADE = {"force": np.array([1.0, np.nan]), "errors": np.ones(2)}


def test_a_table_is_not_lost_to_a_folder_that_takes_nothing(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file where the folder should be")
    found = kept_table(tmp_path / "cache" / "fast" / "a.npz", MADE, lambda: MADE)
    assert np.array_equal(found["force"], MADE["force"], equal_nan=True)


def test_a_full_disk_leaves_no_part_of_a_table(tmp_path: Path) -> None:
    (tmp_path / "a.npz").mkdir()
    assert kept_table(tmp_path / "a.npz", ["x"], lambda: {"x": np.ones(1)})["x"] == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def stored(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def garbled(offset: int, value: int) -> bytes:
    """A whole table but for a byte of the first entry in the zip's directory."""
    content = bytearray(stored(**MADE))
    content[content.index(b"PK\x01\x02") + offset] ^= value
    return bytes(content)


def an_array() -> bytes:
    file = io.BytesIO()
    np.save(file, np.zeros(3))
    return file.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        lambda: b"",
        lambda: stored(**MADE)[:-30],
        lambda: garbled(8, 0x01),  # flags: encrypted
        lambda: garbled(10, 0xFF),  # the way of compression
        lambda: garbled(46, 0x01),  # the name
        an_array,
        lambda: stored(force=MADE["force"]),
        lambda: stored(**MADE, more=np.ones(1)),
    ],
    ids=["empty", "cut", "encrypted", "compressed", "renamed", "array", "lacks", "has more"],
)
def test_what_is_no_whole_table_is_made_anew_and_replaced(
    content: Callable[[], bytes], tmp_path: Path
) -> None:
    made = []

    def make() -> dict[str, np.ndarray]:
        made.append(1)
        return MADE

    file = tmp_path / "a.npz"
    file.write_bytes(content())
    for _ in range(2):
        assert kept_table(file, MADE, make).keys() == MADE.keys()
    assert len(made) == 1
