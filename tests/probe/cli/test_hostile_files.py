"""Files from others: each is refused with a reason, soon, in little memory, and writes nowhere."""

import gzip
import json
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from paths import ROOT
from programs import python

from probe.core.events import Finish, RunEnded, RunStarted, StationStarted
from probe.storage.reader import reading, rows
from probe.storage.rows import FIRST, Row, link
from probe.storage.run import open_run
from probe.storage.schema import create
from probe.storage.writer import create_store

SCENE = """
name = "{name}"
[tissue]
width_mm = 64
height_mm = 16.83
modulus_kpa = 50
poisson = 0.49
"""
RIG = '[scan]\nstart_mm = 28\nstations = 1\n[scene]\nname = "{scene}"\n'
RSS_MB, CPU_S = 200, 2.0


def forged(path: Path, found: list[Row]) -> Path:
    """A run file with these rows and right checksums."""
    connection, chain = sqlite3.connect(path, isolation_level=None), FIRST
    create(connection)
    for number, row in enumerate(found, 1):
        chain = link(chain, row.sha256)
        values = (number, *row, row.sha256, chain)
        connection.execute(
            "INSERT INTO event (id, kind, body, times, readings, saturated, sha256, chain) "
            "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            values,
        )
    connection.close()
    return path


def begun(path: Path, wave: str) -> Path:
    """A run that was broken off, whose scene has the wave file of somebody else."""
    from probe.config.rig import Rig
    from probe.config.scan_plan import plan_for
    from probe.config.snapshot import run_config
    from sim_backend.scene.scene_file import load_scene

    scene, rig = load_scene("TIHA"), Rig()
    config = run_config(rig, scene, plan_for(rig), 0)
    config["scene"]["pulse"]["wave"] = wave
    with create_store(path) as store:
        store(RunStarted(0.0, "2026-01-01T00:00:00+00:00", config, {}))
    return path


def pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def body_of(size: int, part: str) -> str:
    return '{"time_s":0.0,"x":[' + part * (size // len(part)) + "0]}"


def imported(folder: Path, name: str, content: bytes) -> list[str | Path]:
    return ["import", written(folder / name, content), "--out", folder / "a.run"]


def begins_with(folder: Path, command: str, body: str, *, none: bytes | None = None) -> list[Any]:
    """A command on a run file whose first event is forged."""
    return [command, forged(folder / "a.run", [Row("run_started", body, none, none, none)])]


DEEP, TABLES = b"a = " + b"[" * 9000 + b"]" * 9000, b"a = " + b"{b=" * 200 + b"1" + b"}" * 200
HEAD, EMPTY = b"time_s,force_n\n", b"\n" * 10**8
HOSTILE: dict[str, tuple[Callable[[Path], list[Any]], str]] = {
    "scene: a pipe": (lambda d: ["scan", "--scene", pipe(d / "s.toml")], "pipe"),
    "scene: a device": (lambda _: ["scan", "--scene", "/dev/zero"], "device"),
    "scene: deep": (lambda d: ["scan", "--scene", written(d / "s", DEEP)], "nested"),
    "scene: tables in tables": (lambda d: ["scan", "--scene", written(d / "s", TABLES)], "nested"),
    "rig: deep": (lambda d: ["scan", written(d / "r.toml", DEEP), "--dry-run"], "nested"),
    "rig: a pipe": (lambda d: ["scan", pipe(d / "r.toml"), "--dry-run"], "pipe"),
    "resume: a wave without end": (lambda d: ["resume", begun(d / "a.run", "/dev/zero")], "device"),
    "resume: a wave in a pipe": (
        lambda d: ["resume", begun(d / "a.run", str(pipe(d / "w.csv")))], "pipe",
    ),
    "csv: commas": (
        lambda d: imported(d, "a.csv.gz", gzip.compress(b"," * 10**8)),
        "a.csv.gz: a line of more than|unpacks to",
    ),
    "csv: empty lines": (
        lambda d: imported(d, "a.csv.gz", gzip.compress(HEAD + EMPTY)),
        "unpacks to more than|rows are empty",
    ),
    "csv: empty lines, not packed": (
        lambda d: imported(d, "a.csv", HEAD + EMPTY), "rows are empty",
    ),
    "csv: a pipe": (lambda d: ["import", pipe(d / "a.csv"), "--out", d / "a.run"], "pipe"),
    "run: a large event": (
        lambda d: begins_with(d, "verify", body_of(10**8, "[],")), "too big|too large",
    ),
    "run: an event of many values": (
        lambda d: begins_with(d, "detect", body_of(10**7, "[],")), "too many values",
    ),
    "run: an event of many tables": (
        lambda d: begins_with(d, "detect", body_of(10**7, '{"":0},')), "too many values",
    ),
    "run: an event within the bounds": (
        lambda d: begins_with(d, "detect", body_of(10**6, '{"":0},'), none=b""),
        "run_started event",
    ),
    "run: a pipe": (lambda d: ["verify", pipe(d / "a.run")], "pipe or device"),
}  # fmt: skip


# Linux counts into ru_maxrss what the parent held before exec; VmHWM begins anew.
COMMAND = """
import re, sys, time
from pathlib import Path
from probe.cli import main
status = main(sys.argv[2:])
peak_kb = re.search(r"VmHWM:\\s*([0-9]+)", Path("/proc/self/status").read_text())[1]
Path(sys.argv[1]).write_text(f"{peak_kb} {time.process_time()}")
sys.exit(status)
"""


def judged(arguments: list[str | Path], out: Path) -> tuple[int, str, float, float]:
    """Exit status, what was said, peak memory [MB] and processor time [s] of one command."""
    used = out / "used"
    done = python("-c", COMMAND, used, *arguments, cwd=ROOT)
    peak_kb, cpu_s = map(float, used.read_text().split())
    return done.returncode, done.stdout + done.stderr, peak_kb / 1024, cpu_s


@pytest.fixture(scope="module")
def usual_s(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    """Processor time of the same commands when the file is not there."""
    out = tmp_path_factory.mktemp("usual")
    commands: dict[str, list[str | Path]] = {
        "scan": ["scan", "--scene", "none"],
        "resume": ["resume", "none"],
        "import": ["import", "none", "--out", out / "a.run"],
        "verify": ["verify", "none"],
        "detect": ["detect", "none"],
    }
    return {name: judged(words, out)[3] for name, words in commands.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", HOSTILE)
def test_is_refused_soon_and_in_little_memory(
    name: str, tmp_path: Path, usual_s: dict[str, float]
) -> None:
    made, said = HOSTILE[name]
    arguments = made(tmp_path)
    status, words, peak_mb, used_s = judged(arguments, tmp_path)
    print(f"{name}: exit {status}, {peak_mb:.0f} MB, {used_s - usual_s[str(arguments[0])]:.2f} s")
    assert status == 2, words
    assert any(one in words for one in said.split("|")), words
    assert peak_mb < RSS_MB, f"{peak_mb:.0f} MB"
    assert used_s < usual_s[str(arguments[0])] + CPU_S, f"{used_s:.1f} s"


@pytest.mark.usefixtures("springs")
@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "a\\\\b", "", "x\\u001b[31m", "y" * 101])
def test_a_scene_name_leaves_no_folder(name: str, tmp_path: Path, palpate: Callable) -> None:
    (tmp_path / "evil.toml").write_text(SCENE.format(name=name))
    (tmp_path / "rig.toml").write_text(RIG.format(scene="evil.toml"))
    done = palpate("scan", tmp_path / "rig.toml", "--out", tmp_path / "runs", status=2)
    assert "name = " in done.err
    assert "slashes" in done.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["evil.toml", "rig.toml"]


@pytest.mark.usefixtures("springs")
def test_names_print_no_terminal_escapes(tmp_path: Path, palpate: Callable) -> None:
    evil = "x\x1b]0;pwned\x07\x9b31m\u202e"
    path = tmp_path / "a.run"
    with create_store(path) as store:
        store(RunStarted(0.0, evil, {"scene": {"name": evil}, "face_mm2": 100}, {}))
        store(StationStarted(0.0, 0, 1, 0.0, 0.0))
        store(RunEnded(1.0, Finish.FAULTED, evil))
    for arguments in (
        ["replay", path],
        ["verify", path],
        ["detect", path],
        ["detect", path, "--json"],
    ):
        done = palpate(*arguments)
        assert all(c.isprintable() or c in "\n\t" for c in done.out + done.err), done
    assert "\\u001b]0;pwned\\u0007\\u009b31m" in palpate("replay", path).out


def test_an_escaped_answer_is_still_json(capfd: pytest.CaptureFixture[str]) -> None:
    from probe.cli.say import answer_json

    answer_json({"name": "\x1b\x9b\u202e\U000e0001é"})
    out = capfd.readouterr().out
    assert json.loads(out) == {"name": "\x1b\x9b\u202e\U000e0001é"}
    assert all(c.isprintable() for c in out.rstrip("\n"))


@pytest.mark.parametrize("address", ["socket://:0", "socket://0.0.0.0:0", "socket://[::]:0", "x"])
def test_emulators_are_served_to_this_machine_only(address: str) -> None:
    from drivers.core.errors import ConfigError
    from sim_backend.emulators.serving import TcpLine

    with pytest.raises(ConfigError, match=r"127\.0\.0\.1"):
        TcpLine(address)


def test_rows_of_a_forged_run_are_read(tmp_path: Path) -> None:
    """The forger's checksums are right: what is refused above is refused for its content."""
    body = '{"time_s":0.0,"started_utc":"","config":{},"channels":{}}'
    path = forged(tmp_path / "a.run", [Row("run_started", body, None, None, None)])
    with reading(path) as connection:
        assert len(list(rows(connection))) == 1
    assert open_run(path).started.time_s == 0.0
