"""The site: it builds strictly, and what its pages show can be run as written."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer.main
from paths import ROOT

from probe.cli import build, main

DOCS = ROOT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if "decisions" not in page.parts)
RUN = ("first-scan", "rig", "detector", "sweep", "runs", "notebook")
BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)


def blocks(page: Path, language: str) -> list[str]:
    text = page.read_text(encoding="utf-8")
    return [body for _, found, body in BLOCK.findall(text) if found == language]


def commands(page: Path) -> list[list[str]]:
    """The arguments of each `$ palpate ...` line of a page."""
    joined = (re.sub(r"\\\n\s*", "", body) for body in blocks(page, "console"))
    lines = [line.strip() for body in joined for line in body.splitlines()]
    said = [line.removeprefix("$ ") for line in lines if line.startswith("$ palpate ")]
    return [shlex.split(line, comments=True)[1:] for line in said]


@pytest.fixture(scope="module")
def _site(tmp_path_factory: pytest.TempPathFactory) -> str:
    pytest.importorskip("mkdocs", reason="mkdocs is not installed (extra: docs)")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=280,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return (folder / "reference" / "cli.html").read_text(encoding="utf-8")


def test_the_site_builds_without_a_warning_and_names_every_command(_site: str) -> None:
    group: Any = typer.main.get_command(build())
    for name, command in group.commands.items():
        assert command.hidden or f'id="{name}"' in _site


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(DOCS)))
def test_every_command_shown_is_one(page: Path) -> None:
    """Its name, options and arguments are taken by the command line."""
    group: Any = typer.main.get_command(build())
    context = group.make_context("palpate", [], resilient_parsing=True)
    for said in commands(page):
        name, *rest = said
        assert name in group.commands, f"palpate {name}"
        rest = [word for word in rest if not re.fullmatch(r"\[.*\]|…|\.\.\.", word)]
        group.commands[name].make_context(name, list(rest), parent=context)


def pages_to_run() -> list[Path]:
    return [page for page in PAGES if page.stem in RUN]


def test_all_pages_to_run_are_there() -> None:
    assert sorted(page.stem for page in pages_to_run()) == sorted(RUN)


@pytest.mark.slow
@pytest.mark.parametrize("page", pages_to_run(), ids=lambda p: p.stem)
def test_what_a_page_shows_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "rigs" / "virtual.toml", tmp_path / "rig.toml")
    Path("press.csv").write_text(
        "time_s,force_n\n" + "".join(f"{n / 100},{0.5 + 0.01 * (n % 80)}\n" for n in range(500))
    )
    if page.stem == "runs":
        assert main(["scan", "--scene", "TIHA", "--seed", "1"]) == 0
    for said in commands(page):
        if said[0] == "resume":
            continue  # the run it would go on with is complete
        words = [name for word in said for name in (sorted(map(str, Path().glob(word)))
                 if "*" in word else [word])]  # fmt: skip
        assert main(words) == 0, capsys.readouterr().err
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), globals_for(page))


NAMESPACES: dict[Path, dict[str, Any]] = {}


def globals_for(page: Path) -> dict[str, Any]:
    """One namespace a page, so that a block may use what the one before it made."""
    return NAMESPACES.setdefault(page, {"__name__": page.stem})
