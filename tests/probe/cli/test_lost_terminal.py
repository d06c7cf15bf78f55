"""A terminal that is gone: the scan and its file are not."""

import errno
import io
import json
import os
import pty
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from programs import ended
from rig_files import rig_file

from probe.cli import command_line, main
from probe.cli.progress import counting
from probe.core.events import Finish
from probe.storage.run import open_run
from probe.storage.verify import verify


class Gone(io.StringIO):
    """Standard error whose terminal is closed after ``writes`` writes."""

    def __init__(self, writes: int = 0) -> None:
        super().__init__()
        self.tried: list[str] = []
        self._writes = writes

    def isatty(self) -> bool:
        return self._writes > 0

    def write(self, text: str) -> int:
        self.tried.append(text)
        if len(self.tried) <= self._writes:
            return len(text)
        raise OSError(errno.EIO, "Input/output error")

    def flush(self) -> None:
        if len(self.tried) >= self._writes:
            raise OSError(errno.EIO, "Input/output error")


@pytest.mark.parametrize("writes", [0, 1, 2])
def test_a_scan_ends_whole_without_its_terminal(
    monkeypatch: pytest.MonkeyPatch, rig: Path, writes: int
) -> None:
    """A bar begins with two writes: one hides the cursor, one draws."""
    gone = Gone(writes)
    monkeypatch.setattr(sys, "stderr", gone)
    assert main(["scan", str(rig), "--out", str(rig.parent)]) == 0
    assert len(gone.tried) > writes, "nothing was said, so nothing was lost"
    (run,) = rig.parent.glob("*.run")
    assert verify(run).ok
    assert open_run(run).finish is Finish.COMPLETED


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    return rig_file(tmp_path, start_mm=32.0, stations=1, hold_s=0.1)


@pytest.mark.parametrize("writes", [1, 2])
def test_a_count_that_cannot_be_drawn_ends_no_work(
    monkeypatch: pytest.MonkeyPatch, writes: int
) -> None:
    gone = Gone(writes)
    monkeypatch.setattr(sys, "stderr", gone)
    with counting("presses") as show:
        show(1, 2)
    assert len(gone.tried) > writes


@pytest.mark.usefixtures("rig")
def test_a_scan_whose_streams_are_closed_ends_whole(tmp_path: Path) -> None:
    command = f"{shlex.quote(sys.executable)} -m probe.cli scan rig.toml --out . <&- >&- 2>&-"
    assert subprocess.run(command, shell=True, cwd=tmp_path, check=False).returncode == 0
    (run,) = tmp_path.glob("*.run")
    assert open_run(run).finish is Finish.COMPLETED


@pytest.mark.usefixtures("rig")
def test_a_terminal_that_goes_while_its_bar_is_drawn_costs_no_answer(tmp_path: Path) -> None:
    ours, terminal = pty.openpty()
    command = [sys.executable, "-m", "probe.cli", "scan", "rig.toml", "--out", ".", "--json"]
    with (tmp_path / "answer.json").open("w") as answer:
        scan = subprocess.Popen(command, cwd=tmp_path, stdout=answer, stderr=terminal)
    os.close(terminal)
    assert os.read(ours, 1), "no bar"
    os.close(ours)
    assert scan.wait(60) == 0
    assert json.loads((tmp_path / "answer.json").read_text())["finish"] == "completed"


@pytest.mark.parametrize(("what", "status"), [("scan rig.toml --out .", 0), ("detect no.run", 2)])
@pytest.mark.usefixtures("rig")
def test_words_that_cannot_be_written_change_no_status(
    tmp_path: Path, what: str, status: int
) -> None:
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        how = {"capture_output": False, "cwd": tmp_path, "env": buffered, "stderr": full}
        assert ended(*what.split(), **how).returncode == status


@pytest.mark.usefixtures("rig")
def test_a_terminal_that_lacks_a_character_gets_the_answer(tmp_path: Path) -> None:
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = ended("scan", "rig.toml", "--out", ".", cwd=tmp_path, env=ascii_only)
    assert (done.returncode, "? 95 %" in done.stdout) == (0, True), done.stderr


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_an_answer_that_cannot_be_written_is_said(more: list[str]) -> None:
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        how = {"capture_output": False, "stdout": full, "stderr": subprocess.PIPE}
        done = ended("scenes", *more, env=buffered, **how)
    assert done.returncode == 2
    assert done.stderr == (
        "output could not be written: no space left on device; make room there, or name another "
        "place\n"
    )


def unread(folder: Path, *words: str | Path) -> int:
    """The status of a command whose answer nobody reads, as of one before `| head -0`."""
    ours, theirs = os.pipe()
    os.close(ours)
    done = ended(*words, capture_output=False, cwd=folder, stdout=theirs)
    os.close(theirs)
    return done.returncode


@pytest.mark.usefixtures("rig")
def test_a_reader_who_has_enough_is_no_fault(tmp_path: Path) -> None:
    weak = "[safety]\nmax_force_n = 0.5\nhardest_n_mm = 1.0\n"
    (tmp_path / "weak.toml").write_text((tmp_path / "rig.toml").read_text() + weak)
    assert unread(tmp_path, "scan", "rig.toml", "--out", ".") == 0
    (run,) = tmp_path.glob("*.run")
    assert verify(run).ok
    assert unread(tmp_path, "replay", run) == 0
    assert unread(tmp_path, "verify", run, "--json") == 0
    assert unread(tmp_path, "scan", "weak.toml", "--out", "weak") == 3
    assert unread(tmp_path, "watch", "rig.toml") == 0
    assert unread(tmp_path, "--help") == 0
    assert unread(tmp_path) == 2  # no command is none that is done; its help is on the other stream
    assert unread(tmp_path, "scan", "--help") == 0


@pytest.mark.parametrize("error, status", [
    (BrokenPipeError(errno.EPIPE, "a device's"), 1), (SystemExit(3), 3), (SystemExit("why"), 1),
])  # fmt: skip
def test_what_another_part_ends_is_not_done(
    error: BaseException, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A driver of others may exit, and a pipe that is lost need not be the answer's."""
    app = typer.Typer()

    @app.command()
    def broken() -> None:
        raise error

    monkeypatch.setattr(command_line, "build", lambda: app)
    assert command_line.run(["--"]) == status
