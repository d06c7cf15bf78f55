"""Which file system a run lies on."""

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
