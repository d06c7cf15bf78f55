"""Who can reach the remote control of a running scan: this user, on this machine."""

import json
import os
import stat
import sys
from pathlib import Path

import pytest

from probe.guards.commands import Control
from probe.scan.remote import control_path, listening


def test_the_secret_is_for_its_owner_only(tmp_path: Path) -> None:
    run = tmp_path / "a.run"
    before = os.umask(0)
    try:
        with listening(Control(), run):
            mode = stat.S_IMODE(control_path(run).stat().st_mode)
    finally:
        os.umask(before)
    assert mode == 0o600
    assert not control_path(run).exists()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/net/tcp")
def test_the_scan_listens_on_the_loopback_interface_only(tmp_path: Path) -> None:
    run = tmp_path / "a.run"
    with listening(Control(), run):
        port = json.loads(control_path(run).read_text(encoding="utf-8"))["port"]
        lines = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]
    addresses = [line.split()[1].split(":") for line in lines]
    assert [host for host, number in addresses if int(number, 16) == port] == ["0100007F"]
