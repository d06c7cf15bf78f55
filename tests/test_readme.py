"""The README's commands and example in their order, from a wheel in a fresh environment."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PACKAGES = ("palpate", "probe", "drivers", "sim_backend", "calibration")
NO_INDEX = ("Connection", "connection", "Temporary failure", "Name or service", "timed out")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(500)]


def blocks(language: str) -> list[str]:
    """The README's fenced blocks in ``language``."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def sessions() -> list[tuple[str, list[str]]]:
    """Every ``$ palpate`` command with the lines that the README shows under it."""
    found: list[tuple[str, list[str]]] = []
    for line in "\n".join(blocks("console")).splitlines():
        if line.startswith("$ "):
            found.append((line[2:].split("  #")[0], []))
        elif line.strip() not in ("", "…"):
            found[-1][1].append(line.rstrip())
    return [(command, shown) for command, shown in found if command.startswith("palpate")]


def run(command: list[str] | str, cwd: Path, path: Path | None = None) -> str:
    """Standard output of a command that must succeed; skips if there is no package index."""
    environment = dict(os.environ) | {"QT_QPA_PLATFORM": "offscreen", "COLUMNS": "80"}
    environment.pop("PYTHONPATH", None)
    if path is not None:
        environment["PATH"] = f"{path}{os.pathsep}{environment['PATH']}"
    done = subprocess.run(
        command, cwd=cwd, env=environment, text=True, capture_output=True,
        shell=isinstance(command, str), timeout=400, check=False,
    )  # fmt: skip
    if done.returncode and any(word in done.stderr for word in NO_INDEX):
        pytest.skip(f"no package index can be reached: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The ``bin`` folder of a fresh environment: the wheel, the extras that the README names."""
    folder = tmp_path_factory.mktemp("first-time-user")
    source = folder / "source"
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    build = ["wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder)]
    run([*pip, *build, str(source)], folder)  # by the setuptools that is here: no download
    shutil.rmtree(source)
    run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], folder)
    (wheel,) = folder.glob("palpate-*.whl")
    there = ["--python", str(folder / "venv" / "bin" / "python")]
    what = f"{wheel}[report,export,mesh]"
    uv = [sys.executable, "-m", "uv", "pip", "install", "--quiet", "--system-certs", *there, what]
    if subprocess.run(uv, cwd=folder, capture_output=True, check=False).returncode:
        run([*pip, *there, "install", "--no-compile", what], folder)  # has indexes that uv has not
    return folder / "venv" / "bin"


def test_readme_commands(installed: Path, tmp_path: Path) -> None:
    (rig,) = blocks("toml")
    (tmp_path / "rig.toml").write_text(rig, encoding="utf-8")
    assert len(sessions()) >= 4
    for command, shown in sessions():
        printed = [line.rstrip() for line in run(command, tmp_path, installed).splitlines()]
        for line in shown:
            assert line in printed, f"{command} does not print {line!r} but\n{printed}"
    (script,) = blocks("python")
    (tmp_path / "example.py").write_text(script, encoding="utf-8")
    run("python example.py", tmp_path, installed)
    assert list(tmp_path.rglob("report.html"))


def test_pictures_and_links_exist() -> None:
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", README):
        assert (ROOT / target).exists(), f"README.md points to {target}, which is not there"
