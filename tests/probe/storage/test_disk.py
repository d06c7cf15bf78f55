"""Which file system a run lies on."""

import errno
import os
from pathlib import Path

import pytest

import probe.storage.disk
from probe.storage.writer import StoreError, create_store


@pytest.mark.parametrize("kind", ["nfs4", "cifs", "9p", "fuse.sshfs"])
def test_network_file_systems_are_refused(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probe.storage.disk, "file_system", lambda _path: kind)
    with pytest.raises(StoreError, match=rf"network file system \({kind}\).*local disk"):
        create_store(tmp_path / "a.run")
    assert not (tmp_path / "a.run").exists()


def test_the_file_system_of_a_path_is_known() -> None:
    assert probe.storage.disk.file_system(Path("/proc/self")) == "proc"


def test_a_network_folder_with_a_space_in_its_name_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mounts = tmp_path / "mounts"
    mounts.write_bytes(b"/dev/sda / ext4 rw 0 0\nnas:/x /mnt/Our\\040\xc3\xa4ther nfs4 rw 0 0\n")
    monkeypatch.setattr(probe.storage.disk, "MOUNTS", mounts)
    assert probe.storage.disk.file_system(Path("/mnt/Our äther/a.run")) == "nfs4"
    assert probe.storage.disk.file_system(Path("/mnt/Our/a.run")) == "ext4"


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EROFS, "read-only file system; name a place that you may write to"),
        (errno.EACCES, "permission denied; name a place that you may write to"),
        (errno.ENAMETOOLONG, "file name too long"),
        (errno.ENOSPC, "the disk is full (no space left on device); everything committed before"),
    ],
)
def test_why_a_run_cannot_be_written_is_said_whatever_its_folder_is_called(
    number: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A read-only file system was "full" because the word was in the path."""
    path = tmp_path / "full" / "a.run"

    def refused(file: Path) -> int:
        raise OSError(number, os.strerror(number), str(file))

    monkeypatch.setattr(probe.storage.disk, "hold", refused)
    with pytest.raises(StoreError) as said:
        create_store(path)
    assert str(said.value).startswith(f"{path}: {words}")
    assert "Errno" not in str(said.value)
