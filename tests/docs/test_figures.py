"""Measured numbers in the prose come from stored results, and results say where they are from."""

import importlib.util
import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from figures.catalogue import FIGURES
from paths import ROOT

DOCS = ROOT / "docs"
STORED = sorted((DOCS / "figures").glob("*.json"))
PAGES = sorted(page for page in DOCS.rglob("*.md") if "decisions" not in page.parts)
LOOKS_MEASURED = re.compile(
    r"(?<![\w.,])\d[\d,.]*(?: to \d[\d,.]*)? ?"
    r"(?:%|(?:ms|MB|GB|times|minutes?|seconds?|s|scans/s|Pa|kPa)\b)"
)
TYPED = {"explanation/studies.md": 2, "how-to/calibration.md": 4, "how-to/windows.md": 0}
"""How many such numbers a page still has that are settings or typed by hand; lower it only."""


def load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_figures", DOCS / "figures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FILL = load()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(DOCS)))
def test_every_figure_of_a_page_was_measured(page: Path) -> None:
    assert "{{" not in FILL.filled(page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("wrong", [
    '{{ figure("paper.no_such_key") }}', '{{ figure("no_such_result.x") }}',
    '{{ table("demo") }}', '{{ number("paper.presses") }}', '{{ kept("no_such_result") }}',
    '{{ counts("six-scenes", "scene", "no_such_column") }}',
    '{{ greatest("device-faults", "device", "no_such_column") }}',
    '{{ spread("windows", "what", "no_such_column") }}',
    '{{ rows("guard-latency", "no_such_column") }}',
])  # fmt: skip
def test_a_number_that_nothing_backs_stops_the_build(wrong: str) -> None:
    with pytest.raises(FILL.NoFigure):
        FILL.filled(f"It takes {wrong}.")


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of rows per case in the place of the stored ones."""
    monkeypatch.setattr(FILL, "RESULTS", tmp_path)
    FILL.cases.cache_clear()
    yield tmp_path
    FILL.cases.cache_clear()


def test_the_greatest_of_each(results: Path) -> None:
    (results / "made.csv").write_text("device,late_s\na,0.25\nb,3\na,1.5\n")
    text = FILL.filled('{{ greatest("made", "device", "late_s") }}')
    assert text.splitlines()[2:] == ["| a | 2 | 1.5 |", "| b | 1 | 3 |"]


def test_the_spread_of_each(results: Path) -> None:
    rows = "".join(f"a,{n / 10}\n" for n in range(20, 0, -1))
    (results / "made.csv").write_text(f"what,ms\n{rows}b,12.4\n")
    text = FILL.filled('{{ spread("made", "what", "ms") }}')
    assert text.splitlines()[2:] == ["| a | 20 | 1.1 | 1.9 | 2 |", "| b | 1 | 12 | 12 | 12 |"]
    assert FILL.filled('{{ rows("made", "ms") }}').splitlines()[::21] == ["| ms |", "| 0.1 |"]


def test_a_number_is_printed_as_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = {"scans": 1000, "share": 0.12345, "rows": {"a": [1.5, 2.5]}, "head": ["x", "y"],
            "table": [["1", "a|b"]]}  # fmt: skip
    stored = {"date": "2026-11-22", "commit": "abc", "changed": False, "command": "make figures",
              "machine": "2 processors", "data": data}  # fmt: skip
    (tmp_path / "made.json").write_text(json.dumps(stored))
    monkeypatch.setattr(FILL, "STORED", tmp_path)
    FILL.stored.cache_clear()
    text = (
        '{{ figure("made.scans") }} {{ figure("made.share", ".1%") }} {{figure("made.rows.a.1")}}'
    )
    assert FILL.filled(text) == "1,000 12.3% 2.5"
    assert FILL.filled('{{ table("made") }}') == "| x | y |\n|---|---|\n| 1 | a\\|b |"
    assert "at commit abc by `make figures`" in FILL.filled('{{ measured("made") }}')
    FILL.stored.cache_clear()


def test_answers_are_counted_case_by_case(results: Path) -> None:
    lines = [
        "scene,sensor,found,commit,date",
        *["TI,a,nothing,abc,2026-11-22"] * 2,
        "TI,a,artery,abd,2026-11-22",
        "TI,b,,abc,2026-11-22",
        "TIT,b,tumour,abc,2026-11-22",
    ]
    (results / "made.csv").write_text("\n".join(lines))
    table = FILL.filled('{{ counts("made", "sensor", "scene") }}').splitlines()
    assert table == ["| sensor | TI | TIT |", "|---|---|---|", "| a | 2 nothing, 1 artery |  |",
                     "| b |  | 1 tumour |"]  # fmt: skip
    assert FILL.filled('{{ kept("made") }}') == "4 cases of abc, abd (2026-11-22)"


@pytest.mark.parametrize("file", STORED, ids=lambda p: p.stem)
def test_a_stored_result_says_where_it_is_from(file: Path) -> None:
    stored = json.loads(file.read_text(encoding="utf-8"))
    assert file.stem in FIGURES, "no benchmark makes it: benchmarks/figures/catalogue.py"
    assert re.fullmatch(r"20\d\d-\d\d-\d\d", stored["date"])
    assert re.fullmatch(r"[0-9a-f]{7,40}", stored["commit"])
    assert stored["machine"]
    assert stored["command"].startswith("make figures")
    assert stored["data"]


@pytest.mark.parametrize("page", TYPED)
def test_no_more_numbers_are_typed_by_hand(page: str) -> None:
    """Percentages, times and stresses outside code and figures: settings, and what is left."""
    text = (DOCS / page).read_text(encoding="utf-8")
    text = re.sub(r"```.*?```|`[^`]*`|\{\{.*?\}\}", "", text, flags=re.DOTALL)
    found = [number[0] for number in LOOKS_MEASURED.finditer(text)]
    assert len(found) <= TYPED[page], f"{{{{ figure(...) }}}} for a new one: {found}"


def test_the_readme_shows_what_a_scan_prints() -> None:
    printed = json.loads((DOCS / "figures" / "demo.json").read_text(encoding="utf-8"))
    known = {" ".join(line.split()) for line in printed["data"]["printed"].splitlines()}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    block = re.search(r"\$ palpate scan --scene TIHA --seed 1\n(.*?)```", readme, re.DOTALL)
    lines = [" ".join(line.split()) for line in block[1].splitlines() if line.strip()]
    strange = [
        line for line in lines
        if line not in known and not line.startswith(("Run:", "Report:", "runs/", "…", "⋮", "..."))
    ]  # fmt: skip
    assert strange == []
