"""The site: it builds strictly, and what its pages show can be run as written."""

import html
import re
import shlex
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer.main
from paths import ROOT
from programs import python

import palpate
from drivers import available, settings_of
from probe.cli import main
from probe.cli.command_line import build
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for

DOCS = ROOT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if "decisions" not in page.parts)
ELSEWHERE = {
    "add-a-driver.md": "tests/test_add_a_driver.py",
    "calibration.md": "tests/probe/calibrate/test_calibrate.py",
    "windows.md": "tests/probe/gui",
}
"""Pages whose commands and code have tests of their own."""
MINUTES = {"chart": "tests/probe/studies/charts", "fleet": "tests/probe/studies/test_vary.py"}
"""Commands that take minutes as shown; their own tests run smaller ones."""
RUN_OF_PAGES = "TIHA-20260101-120000.run"
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
def _site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="mkdocs is not installed (extra: docs)")
    folder = tmp_path_factory.mktemp("site")
    python("-m", "mkdocs", "build", "--strict", "--site-dir", folder, cwd=ROOT, status=0)
    return folder


def test_the_site_builds_without_a_warning_and_names_every_command(_site: Path) -> None:
    shown = (_site / "reference" / "cli.html").read_text(encoding="utf-8")
    group: Any = typer.main.get_command(build())
    for name, command in group.commands.items():
        assert command.hidden or f'id="{name}"' in shown
        for below in getattr(command, "commands", ()):
            assert f'id="{name}-{below}"' in shown


def test_a_scan_that_a_page_shows_is_planned_within_its_limits(_site: Path) -> None:
    generated = (_site / "reference" / "rig-file.html").read_text(encoding="utf-8")
    made = re.findall(r"<code>(.*?)</code>", generated, re.DOTALL)
    shown = [html.unescape(re.sub(r"<[^>]+>", "", one)) for one in made]
    shown += [block for page in PAGES for block in blocks(page, "toml")]
    scans = [Rig.model_validate(tomllib.loads(one)) for one in shown if "[scan]\n" in one]
    assert len(scans) >= 3
    for rig in scans:
        limits_for(rig, plan_for(rig))


def test_pages_show_lists_not_their_source(_site: Path) -> None:
    glossary = (_site / "glossary.html").read_text(encoding="utf-8")
    assert len(re.findall("<dt>", glossary)) > 10
    for page in _site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"^(<p>)?: {2,}\S", text, re.MULTILINE), page  # a definition's mark


def test_pages_are_whole_without_a_network(_site: Path) -> None:
    """The theme fetches Mermaid from elsewhere as soon as a page has a block of it."""
    for page in _site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:link|script|img|iframe)[^>]*?(?:src|href)=\"([^\"]+)", text)
        assert not [one for one in loaded if re.match(r"(https?:)?//", one)], page
        assert "mermaid" not in text, page
    assert (_site / "pictures" / "states.svg").is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(DOCS)))
def test_every_command_shown_is_one(page: Path) -> None:
    group: Any = typer.main.get_command(build())
    context = group.make_context("palpate", [], resilient_parsing=True)
    for said in commands(page):
        name, *rest = said
        assert name in group.commands, f"palpate {name}"
        rest = [word for word in rest if not re.fullmatch(r"\[.*\]|…|\.\.\.", word)]
        group.commands[name].make_context(name, list(rest), parent=context)


def pages_to_run() -> list[Path]:
    """All that show a command or Python, but those that have a test of their own."""
    pages = [page for page in PAGES if page.name not in ELSEWHERE]
    return [page for page in pages if commands(page) or blocks(page, "python")]


def test_what_is_run_elsewhere_is() -> None:
    for page, where in ELSEWHERE.items():
        tests = ROOT / where
        files = [tests] if tests.is_file() else sorted(tests.glob("test_*.py"))
        assert len([one for one in PAGES if one.name == page]) == 1
        assert tests.is_dir() or any(page in file.read_text("utf-8") for file in files), page
    assert all((ROOT / where).exists() for where in MINUTES.values())


def takes_minutes(said: list[str]) -> bool:
    """Also a sweep as accurate as by default: test_sweep.py runs smaller ones."""
    return said[0] in MINUTES or (said[0] == "sweep" and "--accuracy" not in said)


@pytest.fixture(scope="module")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run for the pages that begin with one."""
    return palpate.scan(scene="TIHA", seed=1, out=tmp_path_factory.mktemp("scanned")).path


@pytest.mark.slow
@pytest.mark.parametrize("page", pages_to_run(), ids=lambda p: p.stem)
def test_what_a_page_shows_runs(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    scanned: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    if "scan" not in [said[0] for said in commands(page)]:
        Path("runs").mkdir()
        for name in (f"runs/{RUN_OF_PAGES}", "before.run", "after.run"):
            shutil.copy(scanned, name)
    shutil.copy(ROOT / "rigs" / "virtual.toml", tmp_path / "rig.toml")
    Path("press.csv").write_text(
        "time_s,force_n\n" + "".join(f"{n / 100},{0.5 + 0.01 * (n % 80)}\n" for n in range(500))
    )
    for said in commands(page):
        if said[0] == "resume" or takes_minutes(said):
            continue  # the run that `resume` would go on with is complete
        words = [name for word in said for name in (sorted(map(str, Path().glob(word)))
                 if "*" in word else [word])]  # fmt: skip
        assert main(words) == 0, capsys.readouterr().err
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), globals_for(page))


@pytest.mark.parametrize(
    "page",
    [
        page
        for page in sorted((DOCS / "reference" / "devices").glob("*.md"))
        if blocks(page, "toml")
    ],
    ids=lambda page: page.stem,
)
def test_the_settings_that_a_device_s_page_shows_are_taken(page: Path) -> None:
    tables = tomllib.loads("\n".join(blocks(page, "toml")))
    rest = {"stage": {"driver": "virtual"}, "sensor": [{"driver": "virtual"}]}
    rig = Rig.model_validate(rest | tables)
    devices = [("stages", rig.stage), *(("sensors", sensor) for sensor in rig.sensor)]
    shown = [(kind, device) for kind, device in devices if device.driver != "virtual"]
    assert shown or page.stem == "virtual"  # whose keys the rig's own schema has taken
    for kind, device in shown:
        taken = settings_of(kind, device.driver).model_validate(device.settings)
        assert taken.model_dump(by_alias=True, exclude_unset=True).keys() >= device.settings.keys()


NAMESPACES: dict[Path, dict[str, Any]] = {}


def globals_for(page: Path) -> dict[str, Any]:
    """One namespace a page, so that a block may use what the one before it made."""
    return NAMESPACES.setdefault(page, {"__name__": page.stem})


@pytest.mark.parametrize("name", ["rig-file", "cli", "api", "scene-file", "findings"])
def test_no_cell_of_a_reference_page_is_empty(name: str, _site: Path) -> None:
    text = (_site / "reference" / f"{name}.html").read_text(encoding="utf-8")
    rows = re.findall(r"<tr.*?</tr>", text, re.DOTALL)
    assert len(rows) > 4
    for row in rows:
        cells = re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.DOTALL)
        words = [re.sub(r"<[^>]+>|\s", "", cell) for cell in cells]
        assert all(words), (name, html.unescape(re.sub(r"<[^>]+>|\s+", " ", row)))


def test_every_key_of_every_device_is_described(_site: Path) -> None:
    text = (_site / "reference" / "rig-file.html").read_text(encoding="utf-8")
    for kind in ("stages", "sensors"):
        for name in available(kind):
            assert f'driver = "{name}"' in html.unescape(text)
    assert text.count("<td><code>origin_mm</code></td>") == 6
