"""A wrong rig or scene file: exit status 2, a message with key and value, no stack trace."""

import errno
import os
from pathlib import Path

import pytest
from own_scene import OWN_SCENE
from programs import ended

from probe.cli.errors import status_of
from probe.config.rig import Rig
from probe.scan.session import scan
from probe.storage.export import WRITERS

pytestmark = pytest.mark.usefixtures("springs")
ONE = Rig.model_validate({"scan": {"start_mm": 28, "stations": 1}})

RIG = """
[stage]
driver = "virtual"
[[sensor]]
driver = "virtual"
[scan]
stations = 3
[safety]
max_force_n = 5.0
[scene]
name = "TIHA"
"""

# (what is in the file, what is written instead, what the message must name)
WRONG_RIGS = [
    ("stations = 3", "stations = 0", ["scan.stations", "0", "must be greater than or equal to 1"]),
    ("stations = 3", "pitch = 4.0", ["did you mean pitch_mm?); known here: approach_mm_s, "]),
    ("stations = 3", "indentation_mm = -1.0", ["scan.indentation_mm", "-1", "0.000001"]),
    ("stations = 3", "indentation_mm = 20.0\nramp_s = 2.0", ["20", "workspace"]),
    ("stations = 3", "travel_mm_s = 80.0", ["scan.travel_mm_s", "80", "max_speed_mm_s"]),
    ("max_force_n = 5.0", "max_force_n = 'five'", ["safety.max_force_n", "five", "number"]),
    ('[stage]\ndriver = "virtual"', '[stage]\ndriver = "ur99"', ["stage", "ur99", "known"]),
    ('name = "TIHA"', 'name = "nowhere.toml"', ["nowhere.toml", "TIHA"]),
    ('[scene]\nname = "TIHA"', "", ["scene.name", "missing", "TIHA"]),
    ('name = "TIHA"', "", ["rig.toml: scene.name is missing\n"]),
    ("[scan]", "[scan", ["not TOML"]),
]  # fmt: skip
PRESS = ["press", "TI", "--x", "32", "--depth", "0.1"]
WRONG_SCENES = [
    ("poisson = 0.49\n[[", "poisson = 0.5\n[[", ["tissue.poisson", "0.5"]),
    ("depth_mm = 12.66", "depth_mm = 2.0", ["depth_mm", "2", "breaks the surface"]),
    ("depth_mm = 12.66", "depth_mm = 15.0", ["depth_mm", "15", "breaks the bottom"]),
    ("x_mm = 32.0", "x_mm = 63.0", ["x_mm", "63", "breaks a side"]),
    ("wall_mm = 1.0", "wall_mm = 0.0", ["wall_mm", "0"]),
    ('kind = "artery"', 'kind = "nerve"', ["kind", "nerve", "tumour"]),
    ("modulus_kpa = 50.0", "modulus_kpa = -50.0", ["tissue.modulus_kpa", "-50"]),
    ('name = "mine"', 'name = "mine"\nplane = "shell"', ["plane", "shell", "strain"]),
    ("height_mm = 16.83", "height_mm = 2.0", ["depth_mm", "12.66"]),
    ('name = "mine"\n', 'name = "mine"\n[pulse]\nwave = "gone.csv"\n', ["gone.csv"]),
]


def wrong(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


def check(outcome: object, named: list[str]) -> None:
    status, out, err = (getattr(outcome, one) for one in ("status", "out", "err"))
    assert status == 2, err
    assert out == ""
    assert "Traceback" not in err
    assert "mistake in palpate" not in err
    assert err.count(".toml: ") <= len(err.splitlines()), "a file is named once"
    for word in named:
        assert word in err


@pytest.mark.parametrize(("old", "new", "named"), WRONG_RIGS)
def test_wrong_rig(palpate, tmp_path: Path, old: str, new: str, named: list[str]) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(wrong(RIG, old, new))
    check(palpate("scan", rig, "--out", tmp_path / "runs"), named)
    assert not list(tmp_path.rglob("*.run")), "nothing may be begun with a wrong rig"


@pytest.mark.parametrize(("old", "new", "named"), WRONG_SCENES)
def test_wrong_scene(palpate, tmp_path: Path, old: str, new: str, named: list[str]) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(wrong(OWN_SCENE, old, new))
    check(palpate("scan", "--scene", scene, "--out", tmp_path / "runs"), named)
    assert not list(tmp_path.rglob("*.run"))


def test_a_right_rig_and_scene_are_taken(palpate, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG.replace("TIHA", "scene.toml"))
    (tmp_path / "scene.toml").write_text(OWN_SCENE)
    palpate("scan", tmp_path / "rig.toml", "--dry-run", "--out", tmp_path, status=0)


@pytest.mark.parametrize("arguments, named", [
    (["scan", "--scene", "TIXX"], ["TIXX", "TIHA"]),
    (["scan", "none.toml"], ["none.toml", "no such file"]),
    (["scan", "--seed", "-1"], ["seed", "-1"]),
    (["scan", "--fallback", "real"], ["--fallback", "real", "virtual"]),
    (["detect", "none.run"], ["none.run"]),
    (["detect", "none.run", "--false-alarm", "2"], ["--false-alarm 2", "between 0 and 1"]),
    (["detect", "none.run", "--ask", "-5"], ["--ask -5", "more than 0"]),
    (["detect", "none.run", "--ask", "nan"], ["--ask nan", "more than 0"]),
    (["compare", "a.run"], ["takes two runs, got 1: a.run"]),
    (["compare", "a.run", "b.run", "c.run"], ["got 3: a.run, b.run, c.run", "name two"]),
    (["compare", "a.run", "./a.run"], ["a.run and a.run are one run; name two"]),
    (["press", "TI", "--x", "32", "--depth", "99"], ["depth_mm", "99", "16.83"]),
    (["press", "TI", "--x", "32"], ["--depth"]),
    (["press", "TI", "--x", "3.2cm", "--depth", "1"], ["'--x'", "'3.2cm' must be a number\n"]),
    (["scan", "--seed", "1.5"], ["'--seed'", "'1.5' must be a whole number\n"]),
    (["sweep", "TI", "--vary", "a=1", "--workers", "0"], ["'0' must be greater than or equal"]),
    ([*PRESS, "--model", "magic"], ["magic", "finite"]),
    (["live", "."], ["a folder"]),
    (["report", "."], [".: a folder; give the run file in it"]),
    (["detect", "/"], ["/: a folder; give the run file in it"]),
    (["sweep", "TI", "--vary", "height_mm=a"], ["--vary height_mm=a", "is no number"]),
    (["scan", "/tmp"], ["/tmp", "a folder", "a file is needed"]),
    (["scan", "--scene", "/tmp"], ["/tmp", "a folder"]),
    (["scan", "--seed", "-1", "--dry-run"], ["--seed", "-1"]),
    (["plan", "--can-i-see", "--noise-mn", "-1"], ["--noise-mn", "-1"]),
    (["runs", ".", "--finding", "artry"], ["artry", "stenotic artery"]),
    (["runs", ".", "--since", "yesterday"], ["yesterday", "2026-01-31"]),
    (["runs", ".", "--note", "gel"], ["say it as KEY=VALUE"]),
    (["scann"], ["scann", "scan"]),
    (["scan", "--stations", "9-5"], ["--stations 9-5"]),
    (["scan", "--stations", "x"], ["--stations x"]),
    (["scan", "--stations", "0"], ["--stations 0"]),
    (["scan", "--stations", "1-"], ["--stations 1-"]),
    (["emulate", "toaster"], ["toaster", "grbl"]),
    (["emulate", "grbl", "--at", "ft300=pty"], ["ft300=pty", "grbl"]),
    (["emulate", "grbl", "--scene", "TIXX"], ["TIXX"]),
    ([*PRESS, "--gradient", "--model", "small"], ["gradients are of finite strain"]),
    ([*PRESS, "--gradient", "--model", "axisymmetric"], ["gradients are of finite strain"]),
    ([*PRESS, "--taxels", "8"], ["must be rows x columns"]),
    ([*PRESS, "--pitch", "1"], ["of which taxels"]),
    ([*PRESS, "--taxels", "0x3"], ["must be rows x columns"]),
    ([*PRESS, "--taxels", "1x3", "--pitch", "-1"], ["must be above 0"]),
    (["press", "TI", "--x", "0.032", "--depth", "0.002"],
     ["less than a thousandth of the finger's 10 mm", "--x 32 --depth 2"]),
])  # fmt: skip
def test_wrong_arguments(palpate, arguments: list[str], named: list[str]) -> None:
    outcome = palpate(*arguments, status=2)
    assert "Traceback" not in outcome.err
    for word in named:
        assert word in outcome.err


def test_can_i_see_refuses_a_driver_that_is_none(palpate, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('[stage]\ndriver = "virtual"\n[[sensor]]\ndriver = "warp"\nnoise_mn = 1\n')
    check(palpate("plan", rig, "--scene", "TI", "--can-i-see"), ["driver = 'warp': no such driver"])


def test_json_tells_errors_too(palpate) -> None:
    outcome = palpate("scan", "--scene", "TIXX", "--json")
    assert outcome.status == outcome.json["status"] == 2
    assert "TIXX" in outcome.json["error"]
    assert "TIXX" in outcome.err


def test_what_the_system_refuses_is_reported_by_file_and_reason() -> None:
    denied = PermissionError(13, "Permission denied", "/root/x.csv")
    said = "/root/x.csv: permission denied; name a place that you may write to"
    assert status_of(denied) == (2, said)
    there = FileExistsError(17, "File exists", "out.csv")
    assert status_of(there) == (2, "out.csv: there is a file; a folder is needed")


def test_a_file_that_may_not_be_read_is_no_place_to_write_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "theirs.csv"
    file.touch()
    monkeypatch.setattr(os, "access", lambda _file, _mode: False)  # who is root may read all
    denied = PermissionError(13, "Permission denied", str(file))
    assert status_of(denied) == (2, f"{file}: permission denied")


@pytest.mark.parametrize("write", ["calibration", "import"])
def test_where_nothing_may_be_written_the_file_is_named_as_it_was_given(
    palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: str
) -> None:
    def denied(path: Path, *_given: object, **_more: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    table, made = tmp_path / "table.csv", tmp_path / "made"
    if write == "calibration":
        table.write_text("raw_0,load_n\n0,0\n1,1\n2,2.01\n3,3\n4,4\n")
        monkeypatch.setattr(Path, "write_text", denied)
        said = palpate("calibrate", "force", table, "--device", "cell", "--out", made)
    else:
        table.write_text("time_s,force_n\n" + "".join(f"{n / 100},1\n" for n in range(50)))
        monkeypatch.setattr("probe.storage.disk.hold", denied)
        said = palpate("import", table, "--out", made, "--face-mm2", "100", status=2)
    assert f"{made}: permission denied; name a place that you may write to\n" in said.err
    assert "Errno" not in said.err


def test_half_a_file_is_not_left_where_there_was_no_room(
    palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, text: str, **_more: object) -> None:
        path.write_bytes(text[:9].encode())
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as limited:
        limited.setattr(Path, "write_text", full)
        said = palpate("init", "rig", tmp_path)
    assert f"{tmp_path / 'rig.schema.json'}: no space left on device; make room" in said.err
    assert palpate("init", "rig", tmp_path).status == 0


def test_who_may_not_write_to_their_home_reads_nothing_of_matplotlib(tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.touch()  # no folder can be made in it, also by root
    own = {**os.environ, "HOME": str(home)}
    for key in ("MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        own.pop(key, None)
    ran = ended("scan", "--scene", "TI", "--dry-run", "--out", tmp_path, env=own)
    assert (tmp_path / "path.png").exists(), ran.stderr
    assert "atplotlib" not in ran.stderr


def test_what_is_no_rig_and_what_takes_no_files_is_named(
    palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, winkler
) -> None:
    def full(_run: object, _folder: Path) -> list[Path]:
        raise OSError(errno.ENOSPC, "No space left on device")

    run = scan(ONE, "TI", tmp_path, respond=winkler).path
    large = tmp_path / "large.run"
    large.write_bytes(run.read_bytes().ljust(2_000_000, b" "))
    assert f"{large}: larger than 1000000 bytes; not a rig file" in palpate("scan", large).err
    monkeypatch.setitem(WRITERS, "csv", full)
    said = palpate("export", run, "--to", "csv", "--out", tmp_path / "e")
    assert (said.status, said.err) == (
        2,
        f"{tmp_path / 'e'}: no space left on device; make room there, or name another place\n",
    )
    assert status_of(OSError(errno.ENOSPC, "No space left on device")) == (
        2, "output could not be written: no space left on device; make room there, or name another "
        "place",
    )  # fmt: skip


@pytest.mark.parametrize("words", [
    ("scan", "--operator", "bad\udcff"),
    ("scan", "--specimen", "bad\udcff", "--dry-run"),
    ("scan", "--note", "bed=bad\udcff"),
    ("calibrate", "force", "gone.csv", "--device", "bad\udcff"),
    ("calibrate", "force", "gone.csv", "--note", "bad\udcff"),
    ("record", "gone.toml", "--device", "bad\udcff"),
])  # fmt: skip
def test_text_that_no_file_can_hold_is_refused_before_anything_opens(
    words: tuple[str, ...], palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    said = palpate(*words)
    (option,) = (word for word in words if word.startswith("--") and word != "--dry-run")
    assert said.status == 2
    assert f"'{option}'" in said.err and r"bad\udcff': holds bytes that are not UTF-8" in said.err
    assert not list(tmp_path.iterdir())


def test_a_scene_whose_name_no_run_can_hold_is_refused_by_the_dry_run_too(
    palpate, tmp_path: Path
) -> None:
    scene = tmp_path / "bad\udcff.toml"
    scene.write_text(OWN_SCENE, encoding="utf-8")
    for more in ((), ("--dry-run",)):
        said = palpate("scan", "--scene", scene, "--out", tmp_path / "runs", *more)
        assert (said.status, "rig.scene.name = " in said.err) == (2, True), said.err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("words", [
    ("scan", "--dry-run", "--out"), ("scan", "--out"), ("scan",), ("scan", "--scene"), ("--log",),
    ("resume",), ("runs",), ("import",), ("init", "rig"), ("scenes",),
])  # fmt: skip
def test_a_path_that_is_too_long_is_refused_in_a_line(
    words: tuple[str, ...], palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    more = {"--log": ["scenes"], "import": ["--out", "a.run"]}.get(words[0], [])
    said = palpate(*words, 300 * "x", *more)
    assert (said.status, said.err.count("\n")) == (2, 1), said.err
    assert "file name too long" in said.err.lower()
