"""``palpate emulate``: served until told to stop, failing on command."""

import signal
import subprocess
import sys
from itertools import takewhile
from pathlib import Path

import pytest


def test_serves_until_terminated_and_fails_on_command(tmp_path: Path) -> None:
    port = tmp_path / "ft300"
    command = [sys.executable, "-m", "probe.cli", "emulate", "ft300", "--scene", "HAOT"]
    with subprocess.Popen(
        [*command, "--at", str(port)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        served = process.stdout.readline()
        assert str(port) in served
        assert "silence" in served
        assert port.is_char_device()
        process.stdin.write("ft300 silence\nft300 nonsense\nft300 ok\n")
        process.stdin.flush()
        said = list(takewhile(lambda line: line != "ft300: ok\n", process.stderr))
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=20)
    assert "ft300: silence\n" in said
    assert any("nonsense" in line and "drop" in line for line in said)
    assert process.returncode == 0
    assert not port.exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["toaster"], ["toaster", "grbl"]),
        (["grbl", "--at", "ft300=pty"], ["ft300=pty", "grbl"]),
        (["grbl", "--scene", "TIXX"], ["TIXX"]),
    ],
)
def test_what_cannot_be_emulated(palpate, arguments: list[str], named: list[str]) -> None:
    outcome = palpate("emulate", *arguments)
    assert outcome.status == 2
    for word in named:
        assert word in outcome.err
